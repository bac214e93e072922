//! One cuboid fitted to all that is seen of it.

use cornerbench::detect::Detection;
use cornerbench::geometry::{Camera, Distortion, ImagePoint};
use cornerbench::image::Plane;
use cornerbench::plan::read_camera;
use cornerbench::refine::cuboid_fit::CuboidFit;
use cornerbench::refine::junction_fit::JunctionFit;
use cornerbench::refine::{Corner, RefineStatus, Refiner};
use cornerbench::scene::{Dataset, Visibility};
use cornerbench::sensor::{Encoding, Exposure, Transfer};
use nalgebra::{Point3, Rotation3, Vector3};

use crate::support::{plain_dataset, project};

const CAMERA: Camera = Camera {
    width: 160,
    height: 140,
    fx_px: 300.0,
    fy_px: 300.0,
    cx_px: 81.3,
    cy_px: 68.2,
    distortion: Distortion::NONE,
};

/// Half the sides \[m\], the turn and the middle of the cuboid that is drawn.
const HALVES_M: [f64; 3] = [0.05, 0.035, 0.04];

fn vertices() -> [Vector3<f64>; 8] {
    let turn = Rotation3::from_euler_angles(0.6, 0.5, 0.3);
    std::array::from_fn(|vertex| {
        let sign = |axis: usize| if vertex & 1 << axis == 0 { -1.0 } else { 1.0 };
        let local = Vector3::from_fn(|axis, _| sign(axis) * HALVES_M[axis]);
        turn * local + Vector3::new(0.0, 0.0, 0.42)
    })
}

/// The cuboid, each face of one level, by the ray through each of 12 x 12 places of a pixel; what `hides` it is
/// black.
fn drawn(hides: impl Fn(f64, f64) -> bool) -> Exposure {
    const PLACES: usize = 12;
    let turn = Rotation3::from_euler_angles(0.6, 0.5, 0.3);
    let value = |x: f64, y: f64| {
        if hides(x, y) {
            return 0.02;
        }
        let ray = turn.inverse() * CAMERA.ray(ImagePoint::new(x, y));
        let origin = turn.inverse() * Vector3::new(0.0, 0.0, -0.42);
        // Where the ray enters and leaves the slabs between opposite faces.
        let (mut enters, mut leaves, mut level) = (f64::NEG_INFINITY, f64::INFINITY, 0.0);
        for axis in 0..3 {
            let [a, b] = [-1.0, 1.0].map(|side| (side * HALVES_M[axis] - origin[axis]) / ray[axis]);
            if a.min(b) > enters {
                (enters, level) = (a.min(b), [0.75, 0.45, 0.25][axis]);
            }
            leaves = leaves.min(a.max(b));
        }
        if enters < leaves { level } else { 0.1 }
    };
    let plane = Plane::from_fn(CAMERA.width as usize, CAMERA.height as usize, |x, y| {
        let place =
            |middle: usize, part: usize| middle as f64 - 0.5 + (part as f64 + 0.5) / PLACES as f64;
        let sum: f64 = (0..PLACES * PLACES)
            .map(|part| value(place(x, part % PLACES), place(y, part / PLACES)))
            .sum();
        #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
        let sample = (65535.0 * sum / (PLACES * PLACES) as f64) as f32;
        sample
    });
    let encoding = Encoding { bit_depth: 16, transfer: Transfer::Linear, black_dn: 0.0 };
    Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("finite")
}

fn seeds() -> Vec<Detection> {
    vertices()
        .iter()
        .enumerate()
        .map(|(index, vertex)| {
            let point = CAMERA.project(&Point3::from(*vertex)).expect("in front");
            let (sine, cosine) = (2.4 * index as f64).sin_cos();
            Detection::new(ImagePoint::new(point.x + 1.5 * cosine, point.y + 1.5 * sine), 1.0)
        })
        .collect()
}

/// Errors of the corners that were answered \[px\].
fn errors_px(corners: &[Corner]) -> Vec<f64> {
    let truth = vertices().map(|vertex| CAMERA.project(&Point3::from(vertex)).expect("in front"));
    corners
        .iter()
        .zip(truth)
        .filter(|(corner, _)| corner.status == RefineStatus::Ok)
        .map(|(corner, truth)| corner.position.distance_px(truth))
        .collect()
}

#[test]
fn a_drawn_cuboid_s_seven_corners_are_found_to_a_hundredth_of_a_pixel() {
    let exposure = drawn(|_, _| false).with_camera(CAMERA);
    let corners = CuboidFit::default().refine(&exposure, &seeds());
    let errors = errors_px(&corners);
    assert_eq!(errors.len(), 7, "{corners:?}");
    assert!(errors.iter().all(|error_px| *error_px < 0.02), "{errors:?}");
    // The eighth belongs to no face that looks at the camera.
    let hidden: Vec<_> =
        corners.iter().filter(|c| c.status == RefineStatus::NotApplicable).collect();
    assert_eq!(hidden.len(), 1);
    assert_eq!(hidden[0].position, hidden[0].seed.point);
}

#[test]
fn what_hides_parts_of_edges_does_not_move_the_cuboid() {
    // A bar across three edges, a disc on a fourth.
    let hides = |x: f64, y: f64| (x - 52.0).abs() < 4.0 || (x - 98.0).hypot(y - 92.0) < 6.0;
    let exposure = drawn(hides).with_camera(CAMERA);
    let corners = CuboidFit::default().refine(&exposure, &seeds());
    let errors = errors_px(&corners);
    assert!(errors.len() >= 6, "{corners:?}");
    assert!(errors.iter().all(|error_px| *error_px < 0.05), "{errors:?}");
}

#[test]
fn without_intrinsics_or_cuboid_it_is_not_applicable() {
    let without = CuboidFit::default().refine(&drawn(|_, _| false), &seeds());
    let flat = drawn(|_, _| true).with_camera(CAMERA);
    let flat = CuboidFit::default().refine(&flat, &seeds());
    // Corners of all kinds, but of no cuboid.
    let plane = Plane::from_fn(CAMERA.width as usize, CAMERA.height as usize, |x, y| {
        200.0 * crate::drawn::texture(x / 9, y / 7)
    });
    let encoding = Encoding { bit_depth: 16, transfer: Transfer::Linear, black_dn: 0.0 };
    let texture = Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("finite");
    let everywhere: Vec<Detection> = (1..15)
        .flat_map(|x| (1..18).map(move |y| (9.0 * f64::from(x) - 0.5, 7.0 * f64::from(y) - 0.5)))
        .map(|(x, y)| Detection::new(ImagePoint::new(x, y), x + y))
        .collect();
    let texture = CuboidFit::default().refine(&texture.with_camera(CAMERA), &everywhere);
    for corner in without.iter().chain(&flat).chain(&texture) {
        assert_eq!(corner.status, RefineStatus::NotApplicable, "{corner:?}");
        assert_eq!(corner.position, corner.seed.point);
    }
}

#[test]
fn on_rendered_scenes_it_is_better_than_corners_alone() {
    let dataset = Dataset::open(plain_dataset()).expect("the dataset");
    let photographer = read_camera(&project().join("scenes"), "ideal").expect("a camera");
    let mut squares = [0.0; 2];
    let mut count = 0.0;
    for name in dataset.scenes() {
        let scene = dataset.read(name).expect("a scene");
        let camera = scene.description.camera;
        let photograph =
            photographer.take(&scene.film, &camera, [0.0, 0.0], &["cuboid"]).expect("taken");
        let seen: Vec<ImagePoint> = scene
            .truth
            .corners
            .iter()
            .filter(|corner| corner.visibility == Visibility::Visible)
            .map(|corner| corner.image_point_px)
            .collect();
        let seeds: Vec<Detection> = seen
            .iter()
            .map(|point| Detection::new(ImagePoint::new(point.x + 1.0, point.y - 0.7), 1.0))
            .collect();
        let answers = [
            CuboidFit::default().refine(&photograph.exposure, &seeds),
            JunctionFit::default().refine(&photograph.exposure, &seeds),
        ];
        for (index, truth) in seen.iter().enumerate() {
            let both = [&answers[0][index], &answers[1][index]];
            if both.iter().all(|corner| corner.status == RefineStatus::Ok) {
                let errors = both.map(|corner| corner.position.distance_px(*truth));
                squares = [squares[0] + errors[0].powi(2), squares[1] + errors[1].powi(2)];
                count += 1.0;
            }
        }
    }
    assert!(count >= 5.0, "{count}");
    let [cuboid_px, junction_px] = squares.map(|sum: f64| (sum / count).sqrt());
    assert!(cuboid_px < 0.04 && cuboid_px < junction_px, "{cuboid_px} {junction_px}");
}
