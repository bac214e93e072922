//! Drawn cuboids in random poses, what stands before them, and the corners that would be found.

use cornerbench::detect::Detection;
use cornerbench::geometry::{Camera, ImagePoint};
use cornerbench::image::{PixelRange, Plane};
use cornerbench::refine::{Corner, RefineStatus};
use cornerbench::sensor::{Encoding, Exposure, Transfer};
use cornerbench::target::TargetRegion;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

pub(super) const SIZE: usize = 512;
pub(super) const FOCAL_PX: f64 = 470.0;
pub(super) const CAMERA: Camera = Camera::pinhole(512, 512, FOCAL_PX);

/// SplitMix64 (Steele, Lea & Flood 2014): the same scenes on every machine.
pub(super) struct Random(u64);

impl Random {
    pub(super) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub(super) fn below(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count - 1)
    }

    /// Uniform in the disc of `radius`.
    pub(super) fn disc(&mut self, radius: f64) -> [f64; 2] {
        let (r, angle) = (radius * self.unit().sqrt(), self.between(0.0, std::f64::consts::TAU));
        [r * angle.cos(), r * angle.sin()]
    }

    /// Standard normal (Box-Muller).
    pub(super) fn normal(&mut self) -> f64 {
        let r = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        r * (std::f64::consts::TAU * self.unit()).cos()
    }
}

/// The outline of an occluder.
pub(super) enum Shape {
    Ellipse { centre: ImagePoint, axes: [f64; 2], angle: f64 },
    Convex(Vec<ImagePoint>),
}

impl Shape {
    pub(super) fn contains(&self, p: ImagePoint) -> bool {
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
    pub(super) fn bar(centre: ImagePoint, half: [f64; 2], angle: f64) -> Self {
        let (c, s) = (angle.cos(), angle.sin());
        let at =
            |u: f64, v: f64| ImagePoint::new(centre.x + u * c - v * s, centre.y + u * s + v * c);
        let [a, b] = half;
        Self::Convex(vec![at(-a, -b), at(a, -b), at(a, b), at(-a, b)])
    }

    /// A point where a detector would see a corner of the occluder itself.
    pub(super) fn tip(&self, random: &mut Random) -> ImagePoint {
        match self {
            Self::Ellipse { centre, axes, angle } => {
                let sign = if random.unit() < 0.5 { -axes[0] } else { axes[0] };
                ImagePoint::new(centre.x + sign * angle.cos(), centre.y + sign * angle.sin())
            }
            Self::Convex(corners) => corners[random.below(corners.len())],
        }
    }
}

pub(super) fn is_inside(clockwise: &[ImagePoint], p: ImagePoint) -> bool {
    (0..clockwise.len()).all(|n| {
        let (a, b) = (clockwise[n], clockwise[(n + 1) % clockwise.len()]);
        (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x) >= 0.0
    })
}

/// Something in front of the target.
pub(super) struct Occluder {
    pub(super) shape: Shape,
    pub(super) colour: [f64; 3],
}

/// A visible face of the drawn cuboid.
pub(super) struct TrueFace {
    /// Clockwise as seen.
    pub(super) corners: [ImagePoint; 4],
    /// Red [DN].
    pub(super) level_dn: f64,
    /// Share of its image that is hidden.
    pub(super) hidden: f64,
}

pub(super) struct Scene {
    pub(super) exposure: Exposure,
    pub(super) region: TargetRegion,
    pub(super) corners: Vec<Corner>,
    pub(super) faces: Vec<TrueFace>,
    /// Share of the target's image that is hidden.
    pub(super) hidden: f64,
}

/// The corner points that a detector and a refiner would hand on.
pub(super) fn corners_at(points: &[ImagePoint]) -> Vec<Corner> {
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
pub(super) fn red_region(exposure: &Exposure) -> Option<TargetRegion> {
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
pub(super) fn draw_scene(seed: u64, occluders: u64, missed_share: f64) -> Option<Scene> {
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
pub(super) fn cuboid(random: &mut Random, centre: ImagePoint, across_px: f64) -> Vec<TrueFace> {
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
    pub(super) fn before(random: &mut Random, target: ImagePoint, across_px: f64) -> Self {
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
pub(super) fn paint(
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
pub(super) fn corner_points(
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

/// The area of a quadrilateral, positive where its corners are clockwise as seen \[px^2\].
pub(super) fn signed_area(c: &[ImagePoint; 4]) -> f64 {
    (0..4).map(|n| c[n].x * c[(n + 1) % 4].y - c[n].y * c[(n + 1) % 4].x).sum::<f64>() / 2.0
}
