//! The face selector on drawn cuboids: random poses, three shades, occluders, imperfect corners.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "small numbers, drawn here"
)]

mod drawing;

use std::time::{Duration, Instant};

use cornerbench::geometry::{Camera, ImagePoint, Pose};
use cornerbench::grasp::{self, Face, FaceSelector, NoFace};
use cornerbench::image::Plane;
use cornerbench::registry;
use cornerbench::sensor::{Encoding, Exposure, RangeImage, Rig, Transfer};
use cornerbench::target::TargetRegion;
use geo::{Area, BooleanOps, Coord, LineString, Polygon};

use drawing::{Scene, Shape, TrueFace, corners_at, draw_scene, red_region, signed_area};

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

/// Nothing of it matters to what is tested here.
fn rig() -> Rig {
    let camera = Camera::pinhole(128, 128, 128.0);
    Rig { camera, world_from_camera: Pose::identity(), object_size_m: None }
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
                let answer = selector.select(
                    &scene.exposure,
                    &scene.region,
                    &scene.corners,
                    &rig(),
                    &RangeImage::blind(),
                );
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
    selector().select(&scene.0, &scene.1, &corners_at(&points), &rig(), &RangeImage::blind())
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
