//! The face selector on drawn cuboids: random poses, three shades, occluders, imperfect corners.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "small numbers, drawn here"
)]

use std::time::{Duration, Instant};

use cornerbench::detect::Detection;
use cornerbench::geometry::{Camera, Distortion, ImagePoint};
use cornerbench::grasp::{self, Face, FaceSelector, NoFace};
use cornerbench::image::{PixelRange, Plane};
use cornerbench::refine::{Corner, RefineStatus};
use cornerbench::registry;
use cornerbench::sensor::{Encoding, Exposure, Transfer};
use cornerbench::target::TargetRegion;
use geo::{Area, BooleanOps, Coord, LineString, Polygon};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

const SIZE: usize = 512;
const FOCAL_PX: f64 = 470.0;
const CAMERA: Camera = Camera {
    width: 512,
    height: 512,
    fx_px: FOCAL_PX,
    fy_px: FOCAL_PX,
    cx_px: 255.5,
    cy_px: 255.5,
    distortion: Distortion::NONE,
};

/// SplitMix64 (Steele, Lea & Flood 2014): the same scenes on every machine.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn below(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count - 1)
    }

    /// Uniform in the disc of `radius`.
    fn disc(&mut self, radius: f64) -> [f64; 2] {
        let (r, angle) = (radius * self.unit().sqrt(), self.between(0.0, std::f64::consts::TAU));
        [r * angle.cos(), r * angle.sin()]
    }

    /// Standard normal (Box-Muller).
    fn normal(&mut self) -> f64 {
        let r = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        r * (std::f64::consts::TAU * self.unit()).cos()
    }
}

/// The outline of an occluder.
enum Shape {
    Ellipse { centre: ImagePoint, axes: [f64; 2], angle: f64 },
    Convex(Vec<ImagePoint>),
}

impl Shape {
    fn contains(&self, p: ImagePoint) -> bool {
        match self {
            Self::Ellipse { centre, axes, angle } => {
                let (x, y) = (p.x - centre.x, p.y - centre.y);
                let u = (x * angle.cos() + y * angle.sin()) / axes[0];
                let v = (y * angle.cos() - x * angle.sin()) / axes[1];
                u * u + v * v <= 1.0
            }
            Self::Convex(corners) => is_inside(corners, p),
        }
    }

    /// A rectangle that stands like a leg.
    fn bar(centre: ImagePoint, half: [f64; 2], angle: f64) -> Self {
        let (c, s) = (angle.cos(), angle.sin());
        let at =
            |u: f64, v: f64| ImagePoint::new(centre.x + u * c - v * s, centre.y + u * s + v * c);
        let [a, b] = half;
        Self::Convex(vec![at(-a, -b), at(a, -b), at(a, b), at(-a, b)])
    }

    /// A point where a detector would see a corner of the occluder itself.
    fn tip(&self, random: &mut Random) -> ImagePoint {
        match self {
            Self::Ellipse { centre, axes, angle } => {
                let sign = if random.unit() < 0.5 { -axes[0] } else { axes[0] };
                ImagePoint::new(centre.x + sign * angle.cos(), centre.y + sign * angle.sin())
            }
            Self::Convex(corners) => corners[random.below(corners.len())],
        }
    }
}

fn is_inside(clockwise: &[ImagePoint], p: ImagePoint) -> bool {
    (0..clockwise.len()).all(|n| {
        let (a, b) = (clockwise[n], clockwise[(n + 1) % clockwise.len()]);
        (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x) >= 0.0
    })
}

/// Something in front of the target.
struct Occluder {
    shape: Shape,
    colour: [f64; 3],
}

/// A visible face of the drawn cuboid.
struct TrueFace {
    /// Clockwise as seen.
    corners: [ImagePoint; 4],
    /// Red [DN].
    level_dn: f64,
    /// Share of its image that is hidden.
    hidden: f64,
}

struct Scene {
    exposure: Exposure,
    region: TargetRegion,
    corners: Vec<Corner>,
    faces: Vec<TrueFace>,
    /// Share of the target's image that is hidden.
    hidden: f64,
}

/// The corner points that a detector and a refiner would hand on.
fn corners_at(points: &[ImagePoint]) -> Vec<Corner> {
    points
        .iter()
        .zip((0..points.len()).rev())
        .map(|(&point, rank)| Corner {
            seed: Detection::new(point, rank as f64),
            position: point,
            covariance_px2: None,
            iterations: 1,
            status: RefineStatus::Ok,
        })
        .collect()
}

/// The largest 4-connected set of pixels whose red exceeds green and blue by 100 DN.
fn red_region(exposure: &Exposure) -> Option<TargetRegion> {
    let [red, green, blue] = exposure.rgb();
    let (width, height) = (exposure.width(), exposure.height());
    let is_red = Plane::from_fn(width, height, |x, y| {
        red.at(x, y) - green.at(x, y) > 100.0 && red.at(x, y) - blue.at(x, y) > 100.0
    });
    let mut seen = Plane::filled(width, height, false);
    let mut largest: Vec<(usize, usize)> = Vec::new();
    for start in (0..width * height).map(|i| (i % width, i / width)) {
        if seen.at(start.0, start.1) || !is_red.at(start.0, start.1) {
            continue;
        }
        let (mut found, mut open) = (Vec::new(), vec![start]);
        seen.row_mut(start.1)[start.0] = true;
        while let Some((x, y)) = open.pop() {
            found.push((x, y));
            let around = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
            for (x, y) in around {
                if x < width && y < height && is_red.at(x, y) && !seen.at(x, y) {
                    seen.row_mut(y)[x] = true;
                    open.push((x, y));
                }
            }
        }
        if found.len() > largest.len() {
            largest = found;
        }
    }
    let mut mask = Plane::filled(width, height, false);
    for &(x, y) in &largest {
        mask.row_mut(y)[x] = true;
    }
    let range = PixelRange {
        x0: largest.iter().map(|p| p.0).min()?,
        y0: largest.iter().map(|p| p.1).min()?,
        x1: largest.iter().map(|p| p.0).max()? + 1,
        y1: largest.iter().map(|p| p.1).max()? + 1,
    };
    let [left, top, right, bottom] =
        [range.x0, range.y0, range.x1 - 1, range.y1 - 1].map(|v| v as f64);
    let quadrilateral =
        [[left, top], [right, top], [right, bottom], [left, bottom]].map(ImagePoint::from);
    Some(TargetRegion { mask, range, quadrilateral, pixels: largest.len() })
}

/// A random scene with `occluders` in front of the target, whose true corners are each missed by
/// the detector with probability `missed_share`.
fn draw_scene(seed: u64, occluders: u64, missed_share: f64) -> Option<Scene> {
    let random = &mut Random(seed);
    let across_px = random.between(40.0, 200.0);
    let centre = ImagePoint::new(random.between(130.0, 380.0), random.between(130.0, 380.0));
    let mut faces = cuboid(random, centre, across_px);
    let occluders: Vec<Occluder> =
        (0..occluders).map(|_| Occluder::before(random, centre, across_px)).collect();
    let (exposure, seen) = paint(random, centre, across_px, &faces, &occluders);
    for (face, (all, hidden)) in faces.iter_mut().zip(&seen) {
        face.hidden = f64::from(*hidden) / f64::from(*all).max(1.0);
    }
    let (all, hidden) = seen.iter().fold((0, 0), |sum, face| (sum.0 + face.0, sum.1 + face.1));
    let points = corner_points(random, centre, across_px, &faces, &occluders, missed_share);
    Some(Scene {
        region: red_region(&exposure)?,
        exposure,
        corners: corners_at(&points),
        faces,
        hidden: f64::from(hidden) / f64::from(all).max(1.0),
    })
}

/// The visible faces of a cuboid in a random pose, about `across_px` from end to end, whose longest
/// side is at most 2.5 times its shortest.
fn cuboid(random: &mut Random, centre: ImagePoint, across_px: f64) -> Vec<TrueFace> {
    let half = Vector3::from_fn(|_, _| random.between(0.4, 1.0));
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(
        random.normal(),
        random.normal(),
        random.normal(),
        random.normal(),
    ));
    let depth = FOCAL_PX * 2.0 * half.norm() / across_px;
    let middle = CAMERA.unproject(centre, depth);
    let mut levels_dn =
        [random.between(195.0, 230.0), random.between(170.0, 180.0), random.between(150.0, 155.0)];
    levels_dn.rotate_left(random.below(3));

    let mut faces = Vec::new();
    for (axis, level_dn) in levels_dn.into_iter().enumerate() {
        for side in [-1.0, 1.0] {
            let at = |u: f64, v: f64| {
                let mut signs = Vector3::repeat(side);
                signs[(axis + 1) % 3] = u;
                signs[(axis + 2) % 3] = v;
                middle + rotation * half.component_mul(&signs)
            };
            let mut normal = Vector3::zeros();
            normal[axis] = side;
            if (rotation * normal).dot(&at(0.0, 0.0).coords) >= 0.0 {
                continue;
            }
            let mut corners = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)]
                .map(|point| CAMERA.project(&point).expect("in front of the camera"));
            if signed_area(&corners) < 0.0 {
                corners.reverse();
            }
            faces.push(TrueFace { corners, level_dn, hidden: 0.0 });
        }
    }
    faces
}

impl Occluder {
    /// A leaf, a disc or a leg, green or brown, somewhere before the target.
    fn before(random: &mut Random, target: ImagePoint, across_px: f64) -> Self {
        let [dx, dy] = random.disc(0.6 * across_px);
        let centre = ImagePoint::new(target.x + dx, target.y + dy);
        let angle = random.between(0.0, std::f64::consts::PI);
        let mut length = |low: f64, high: f64| across_px * random.between(low, high);
        let shapes = [
            Shape::Ellipse { centre, axes: [length(0.2, 0.6), length(0.03, 0.12)], angle },
            Shape::Ellipse { centre, axes: [length(0.08, 0.3); 2], angle },
            Shape::bar(centre, [length(0.2, 0.8), length(0.04, 0.15)], angle),
        ];
        let shape = shapes.into_iter().nth(random.below(3)).expect("one of three");
        let shade = random.between(0.7, 1.2);
        let colour = [[60.0, 120.0, 40.0], [110.0, 75.0, 50.0]][random.below(2)];
        Self { shape, colour: colour.map(|dn| shade * dn) }
    }
}

/// Paints the scene, 3 x 3 samples per pixel: faces with a ramp and sometimes a soft shadow, noise
/// of 0.5 to 2 DN, a wall and a floor of unlike greys. Also counts, for each face, its samples and
/// those of them that are hidden. Far from the target there is only the background, without noise.
fn paint(
    random: &mut Random,
    centre: ImagePoint,
    across_px: f64,
    faces: &[TrueFace],
    occluders: &[Occluder],
) -> (Exposure, Vec<(u32, u32)>) {
    const SAMPLES: usize = 3;
    let ramp = [0; 2].map(|_| random.between(-0.08, 0.08) / across_px);
    let shadow = random.disc(0.4 * across_px);
    let shadow_radius = across_px * random.between(0.2, 0.6);
    let shadow_depth = if random.unit() < 0.3 { random.between(0.03, 0.1) } else { 0.0 };
    let [wall_dn, floor_dn] = [0; 2].map(|_| random.between(90.0, 220.0));
    let (floor_y, floor_slope) = (random.between(150.0, 400.0), random.between(-0.3, 0.3));
    let noise_dn = random.between(0.5, 2.0);

    let red_of = |face: &TrueFace, p: ImagePoint| {
        let (dx, dy) = (p.x - centre.x, p.y - centre.y);
        let distance = (dx - shadow[0]).hypot(dy - shadow[1]) / shadow_radius;
        let shade = 1.0 - shadow_depth * (1.5 - distance).clamp(0.0, 1.0);
        face.level_dn * shade * (1.0 + ramp[0] * dx + ramp[1] * dy)
    };
    let background = |p: ImagePoint| {
        let is_floor = p.y > floor_y + floor_slope * (p.x - 256.0);
        [if is_floor { floor_dn } else { wall_dn } + 0.02 * p.x; 3]
    };
    let mut seen = vec![(0, 0); faces.len()];
    let mut rgb = [(); 3].map(|()| Plane::filled(SIZE, SIZE, 0.0_f32));
    for y in 0..SIZE {
        for x in 0..SIZE {
            let pixel = ImagePoint::new(x as f64, y as f64);
            let is_near =
                (pixel.x - centre.x).abs().max((pixel.y - centre.y).abs()) < 0.8 * across_px;
            let mut mean_dn = if is_near { [0.0; 3] } else { background(pixel) };
            for sample in 0..if is_near { SAMPLES * SAMPLES } else { 0 } {
                let offset = |i: usize| (i as f64 + 0.5) / SAMPLES as f64 - 0.5;
                let p = ImagePoint::new(
                    pixel.x + offset(sample % SAMPLES),
                    pixel.y + offset(sample / SAMPLES),
                );
                let front = occluders.iter().find(|occluder| occluder.shape.contains(p));
                let face = faces.iter().position(|face| is_inside(&face.corners, p));
                if let Some(face) = face {
                    seen[face].0 += 1;
                    seen[face].1 += u32::from(front.is_some());
                }
                let colour = match (front, face) {
                    (Some(front), _) => front.colour,
                    (None, Some(face)) => [1.0, 0.15, 0.13].map(|c| c * red_of(&faces[face], p)),
                    (None, None) => background(p),
                };
                for c in 0..3 {
                    mean_dn[c] += colour[c] / (SAMPLES * SAMPLES) as f64;
                }
            }
            for c in 0..3 {
                let noise = if is_near { noise_dn * random.normal() } else { 0.0 };
                rgb[c].row_mut(y)[x] = (mean_dn[c] + noise).round().clamp(0.0, 255.0) as f32;
            }
        }
    }
    (
        Exposure::new(rgb, Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 })
            .expect("finite"),
        seen,
    )
}

/// What a detector and a refiner would find, in random order: visible vertices, up to 1.5 px too
/// far inside and 1 px off in any direction; T-junctions where an occluder crosses an edge; two to
/// five points of no use.
fn corner_points(
    random: &mut Random,
    centre: ImagePoint,
    across_px: f64,
    faces: &[TrueFace],
    occluders: &[Occluder],
    missed_share: f64,
) -> Vec<ImagePoint> {
    let moved = |p: ImagePoint, [dx, dy]: [f64; 2]| ImagePoint::new(p.x + dx, p.y + dy);
    let is_hidden = |p: ImagePoint| occluders.iter().any(|occluder| occluder.shape.contains(p));
    let mut vertices: Vec<ImagePoint> = Vec::new();
    let mut edges: Vec<[ImagePoint; 2]> = Vec::new();
    for face in faces {
        for n in 0..4 {
            let (a, b) = (face.corners[n], face.corners[(n + 1) % 4]);
            if !vertices.iter().any(|v| v.distance_px(a) < 1e-6) {
                vertices.push(a);
            }
            if !edges.iter().any(|e| e[0].distance_px(b) < 1e-6 && e[1].distance_px(a) < 1e-6) {
                edges.push([a, b]);
            }
        }
    }

    let mut points = Vec::new();
    for vertex in vertices {
        let inwards = random.between(0.0, 1.5) / vertex.distance_px(centre);
        let pull = [inwards * (centre.x - vertex.x), inwards * (centre.y - vertex.y)];
        let found = moved(moved(vertex, pull), random.disc(1.0));
        let is_missed = random.unit() < missed_share;
        if !is_hidden(vertex) && !is_missed {
            points.push(found);
        }
    }
    for [a, b] in edges {
        let at = |step: u32| {
            let t = f64::from(step) / 400.0;
            ImagePoint::new(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y))
        };
        let crossed = (1..=400).filter(|&step| is_hidden(at(step)) != is_hidden(at(step - 1)));
        points.extend(crossed.map(|step| moved(at(step), random.disc(1.5))));
    }
    for _ in 0..2 + random.below(4) {
        points.push(if occluders.is_empty() {
            moved(centre, random.disc(0.5 * across_px))
        } else {
            let tip = occluders[random.below(occluders.len())].shape.tip(random);
            moved(tip, random.disc(1.5))
        });
    }
    for last in (1..points.len()).rev() {
        points.swap(last, random.below(last + 1));
    }
    points
}

/// Whether a scene has an answer.
#[derive(Clone, Copy)]
enum Wholeness {
    /// A face is whole (hidden by at most 2 %) and all its corners were found.
    Found,
    /// Anything between.
    Doubtful,
    /// Every face is hidden by more than 8 %.
    None,
}

impl Scene {
    /// Faces worth grasping: at least 12 % of the target's image.
    fn usable(&self) -> impl Iterator<Item = &TrueFace> {
        let all: f64 = self.faces.iter().map(|face| signed_area(&face.corners)).sum();
        self.faces.iter().filter(move |face| signed_area(&face.corners) > 0.12 * all)
    }

    fn least_hidden(&self) -> f64 {
        self.usable().map(|face| face.hidden).fold(1.0, f64::min)
    }

    fn wholeness(&self) -> Wholeness {
        let is_found = |corner: &ImagePoint| {
            self.corners.iter().any(|found| found.position.distance_px(*corner) < 3.0)
        };
        if self.usable().any(|face| face.hidden <= 0.02 && face.corners.iter().all(is_found)) {
            Wholeness::Found
        } else if self.least_hidden() > 0.08 {
            Wholeness::None
        } else {
            Wholeness::Doubtful
        }
    }
}

fn signed_area(c: &[ImagePoint; 4]) -> f64 {
    (0..4).map(|n| c[n].x * c[(n + 1) % 4].y - c[n].y * c[(n + 1) % 4].x).sum::<f64>() / 2.0
}

fn overlap(a: &[ImagePoint; 4], b: &[ImagePoint; 4]) -> f64 {
    let polygon = |c: &[ImagePoint; 4]| {
        let ring = c.iter().map(|p| Coord { x: p.x, y: p.y }).collect();
        Polygon::new(LineString::new(ring), vec![])
    };
    let (a, b) = (polygon(a), polygon(b));
    let both = a.intersection(&b).unsigned_area();
    both / (a.unsigned_area() + b.unsigned_area() - both)
}

/// What became of one scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    /// The least occluded face, or one within 2 % of it.
    Right,
    AnotherFace,
    NotAFace,
    Declined,
}

fn judge(scene: &Scene, answer: Result<Face, NoFace>) -> Verdict {
    let Ok(face) = answer else { return Verdict::Declined };
    let nearest = scene
        .faces
        .iter()
        .map(|truth| (overlap(&truth.corners, &face.corners), truth.hidden))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    match nearest {
        Some((iou, hidden)) if iou > 0.8 && hidden <= scene.least_hidden() + 0.02 => Verdict::Right,
        Some((iou, _)) if iou > 0.8 => Verdict::AnotherFace,
        _ => Verdict::NotAFace,
    }
}

/// Verdicts counted.
#[derive(Clone, Copy, Default)]
struct Tally([u32; 4]);

impl Tally {
    fn add(&mut self, verdict: Verdict) {
        self.0[verdict as usize] += 1;
    }

    fn total(&self) -> u32 {
        self.0.iter().sum()
    }

    fn share(&self, verdict: Verdict) -> f64 {
        f64::from(self.0[verdict as usize]) / f64::from(self.total().max(1))
    }
}

/// Tallies by how much of the target is hidden (not at all, below 10 %, 30 %, 60 %) and by whether
/// a whole face is there to be found; and the time of one selection.
#[derive(Default)]
struct Rates {
    by_occlusion: [[Tally; 3]; 4],
    selections: u32,
    total: Duration,
    slowest: Duration,
}

impl Rates {
    fn measure(scenes_each: u64, missed: f64) -> Self {
        let selector = selector();
        let mut rates = Self::default();
        for occluders in 0..=5 {
            for number in 0..scenes_each {
                let seed = 1000 * number + occluders;
                let Some(scene) = draw_scene(seed, occluders, missed) else { continue };
                let level = match scene.hidden {
                    hidden if hidden < 0.001 => 0,
                    hidden if hidden < 0.1 => 1,
                    hidden if hidden < 0.3 => 2,
                    hidden if hidden < 0.6 => 3,
                    _ => continue,
                };
                let start = Instant::now();
                let answer = selector.select(&scene.exposure, &scene.region, &scene.corners);
                let took = start.elapsed();
                rates.selections += 1;
                rates.total += took;
                rates.slowest = rates.slowest.max(took);
                rates.by_occlusion[level][scene.wholeness() as usize].add(judge(&scene, answer));
            }
        }
        rates
    }

    fn sum(&self, levels: std::ops::Range<usize>, wholeness: Wholeness) -> Tally {
        let mut sum = Tally::default();
        for tallies in &self.by_occlusion[levels] {
            for (sum, count) in sum.0.iter_mut().zip(tallies[wholeness as usize].0) {
                *sum += count;
            }
        }
        sum
    }
}

fn selector() -> Box<dyn FaceSelector> {
    let entry =
        registry::find(grasp::SELECTORS, "selector", "least_occluded", "test").expect("listed");
    (entry.build)("test", &toml::Table::new()).expect("defaults are valid")
}

/// Prints the rates that the selector's header gives (shown with `--nocapture`).
fn print(rates: &Rates) {
    println!("hidden   whole face      n  right  another  not a face  declined");
    for (level, tallies) in ["0 %", "< 10 %", "< 30 %", "< 60 %"].iter().zip(rates.by_occlusion) {
        for (whole, tally) in ["found", "doubtful", "none"].iter().zip(tallies) {
            let [right, another, wrong, declined] =
                [Verdict::Right, Verdict::AnotherFace, Verdict::NotAFace, Verdict::Declined]
                    .map(|verdict| 100.0 * tally.share(verdict));
            let n = tally.total();
            println!(
                "{level:8} {whole:10} {n:6} {right:6.1} {another:8.1} {wrong:11.1} {declined:9.1}"
            );
        }
    }
    let mean = rates.total / rates.selections.max(1);
    println!("one selection: mean {mean:?}, slowest {:?}", rates.slowest);
}

#[test]
fn a_whole_face_is_found_and_a_hidden_one_is_declined() {
    let rates = Rates::measure(40, 0.0);
    print(&rates);
    let free = rates.sum(0..1, Wholeness::Found);
    assert!(free.total() >= 15 && free.share(Verdict::Right) >= 0.95, "{:?}", free.0);
    let occluded = rates.sum(1..4, Wholeness::Found);
    assert!(occluded.total() >= 15 && occluded.share(Verdict::Right) >= 0.7, "{:?}", occluded.0);
    let none = rates.sum(0..4, Wholeness::None);
    assert!(none.total() >= 15 && none.share(Verdict::NotAFace) <= 0.15, "{:?}", none.0);
}

/// Two faces of a box seen from its height, 200 and 170 DN, on grey, and what stands before them.
fn two_faces(occluders: &[Shape]) -> (Exposure, TargetRegion) {
    let colour = |p: ImagePoint| {
        let is_in = |x: std::ops::Range<f64>| x.contains(&p.x) && (30.0..90.0).contains(&p.y);
        match () {
            () if occluders.iter().any(|shape| shape.contains(p)) => [60.0, 120.0, 40.0],
            () if is_in(20.0..64.0) => [200.0, 30.0, 26.0],
            () if is_in(64.0..96.0) => [170.0, 26.0, 22.0],
            () => [120.0; 3],
        }
    };
    let rgb = [0, 1, 2].map(|c| {
        Plane::from_fn(128, 128, |x, y| colour(ImagePoint::new(x as f64, y as f64))[c] as f32)
    });
    let exposure =
        Exposure::new(rgb, Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 })
            .expect("finite");
    let region = red_region(&exposure).expect("red");
    (exposure, region)
}

/// The corners of the two faces as drawn: edges lie between pixels.
const TWO_FACES: [[f64; 2]; 6] =
    [[19.5, 29.5], [63.5, 29.5], [95.5, 29.5], [95.5, 89.5], [63.5, 89.5], [19.5, 89.5]];

fn select(scene: &(Exposure, TargetRegion), points: &[[f64; 2]]) -> Result<Face, NoFace> {
    let points: Vec<ImagePoint> = points.iter().copied().map(ImagePoint::from).collect();
    selector().select(&scene.0, &scene.1, &corners_at(&points))
}

const LEFT: [[f64; 2]; 4] = [[19.5, 29.5], [63.5, 29.5], [63.5, 89.5], [19.5, 89.5]];
const RIGHT: [[f64; 2]; 4] = [[63.5, 29.5], [95.5, 29.5], [95.5, 89.5], [63.5, 89.5]];

#[test]
fn the_union_of_two_faces_is_not_chosen() {
    let face = select(&two_faces(&[]), &TWO_FACES).expect("two whole faces");
    assert_eq!(face.corners, LEFT.map(ImagePoint::from));
}

#[test]
fn the_other_face_is_chosen_when_a_leaf_covers_the_larger_one() {
    let leaf =
        Shape::Ellipse { centre: ImagePoint::new(38.0, 60.0), axes: [15.0, 6.0], angle: 0.5 };
    let face = select(&two_faces(&[leaf]), &TWO_FACES).expect("one whole face");
    assert_eq!(face.corners, RIGHT.map(ImagePoint::from));
}

#[test]
fn faces_half_covered_are_declined() {
    let bar = Shape::bar(ImagePoint::new(60.0, 66.0), [58.0, 10.2], 0.0);
    let mut points = TWO_FACES.to_vec();
    for x in [19.5, 63.5, 95.5] {
        points.extend([[x, 55.5], [x, 76.5]]);
    }
    assert_eq!(select(&two_faces(&[bar]), &points), Err(NoFace::AllOccluded));
}

#[test]
fn degenerate_corners_are_declined() {
    let scene = two_faces(&[]);
    let collinear = [[20.0, 29.5], [40.0, 29.5], [63.0, 29.5], [80.0, 29.5], [95.0, 29.5]];
    assert_eq!(select(&scene, &collinear), Err(NoFace::AllOccluded));
    assert_eq!(select(&scene, &[[19.5, 29.5]; 6]), Err(NoFace::TooFewCorners));
    assert_eq!(select(&scene, &LEFT[..3]), Err(NoFace::TooFewCorners));
    assert_eq!(select(&scene, &[]), Err(NoFace::TooFewCorners));
    let outside =
        [[-40.0, 2.0], [1e300, 5.0], [f64::NAN, 60.0], [f64::INFINITY, 60.0], [60.0, 128.0]];
    assert_eq!(select(&scene, &outside), Err(NoFace::TooFewCorners));
    // Coincident corners beside good ones do no harm.
    let doubled = [TWO_FACES, TWO_FACES].concat();
    assert_eq!(select(&scene, &doubled).map(|face| face.corners), Ok(LEFT.map(ImagePoint::from)));
}

#[test]
fn the_smallest_image_is_declined() {
    let rgb = [200.0, 20.0, 20.0].map(|dn| Plane::filled(1, 1, dn));
    let exposure =
        Exposure::new(rgb, Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 })
            .expect("finite");
    let region = red_region(&exposure).expect("one pixel");
    assert_eq!(select(&(exposure, region), &[[0.0, 0.0]; 5]), Err(NoFace::TooFewCorners));
}
