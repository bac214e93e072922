//! Grasp estimators on cuboids whose place is known: exact corners and range have no error, and covariances tell the
//! errors of others.

use std::fs;

use cornerbench::geometry::{Camera, Distortion, ImagePoint, Pose};
use cornerbench::grasp::pose::SeenVertex;
use cornerbench::grasp::{ESTIMATORS, Face, Grasp, NoGrasp, SeenCuboid};
use cornerbench::image::Plane;
use cornerbench::random::Stream;
use cornerbench::record::{Record, kind, read_records};
use cornerbench::sensor::{DepthNoise, RangeImage, Rig};
use nalgebra::{Matrix2, Point3, Vector3};

use crate::support::{copy_folder, cornerbench, plain_dataset, recipes, succeed};

const CAMERA: Camera = Camera {
    width: 512,
    height: 512,
    fx_px: 443.4,
    fy_px: 443.4,
    cx_px: 255.5,
    cy_px: 255.5,
    distortion: Distortion { k1: -0.1, k2: 0.02, p1: 0.001, p2: -0.001, k3: 0.0 },
};
const SIZE_M: [f64; 3] = [0.06, 0.09, 0.14];

/// A cuboid in the camera's frame, and one of its faces.
struct Setup {
    pose: Pose,
    size_m: [f64; 3],
    /// Of the face, clockwise as seen.
    vertices: [usize; 4],
    rig: Rig,
}

fn vertex_of(pose: &Pose, size_m: [f64; 3], vertex: usize) -> Point3<f64> {
    let share = |axis: usize| if vertex & 1 << axis == 0 { -0.5 } else { 0.5 };
    pose * Point3::from(Vector3::from_fn(|axis, _| share(axis) * size_m[axis]))
}

impl Setup {
    /// A cuboid somewhere before the camera, and the face that looks at it most.
    fn any(random: &mut Stream) -> Self {
        let turn = Vector3::from_fn(|_, _| random.normal()).normalize();
        let mut across = || 0.3 * random.uniform() - 0.15;
        let at = Vector3::new(across(), across(), 0.7 + across());
        Self::of(Pose::new(at, turn * std::f64::consts::PI * random.uniform()), SIZE_M)
    }

    fn of(pose: Pose, size_m: [f64; 3]) -> Self {
        let world_from_camera =
            Pose::new(Vector3::new(0.3, -0.2, 1.4), Vector3::new(2.8, 0.4, 0.1));
        let rig =
            Rig { camera: CAMERA, world_from_camera, object_size_m: Some([0.14, 0.06, 0.09]) };
        let faces = (0..6).map(|face| {
            let (axis, end) = (face / 2, face % 2);
            let [u, v] = [(axis + 1) % 3, (axis + 2) % 3].map(|other| 1_usize << other);
            let from = end << axis;
            let vertices = [from, from | u, from | u | v, from | v];
            // From outside clockwise where the axis points away from it.
            if end == 1 { [vertices[0], vertices[3], vertices[2], vertices[1]] } else { vertices }
        });
        let slope = |vertices: &[usize; 4]| {
            let at = vertices.map(|vertex| vertex_of(&pose, size_m, vertex));
            let normal = (at[3] - at[0]).cross(&(at[1] - at[0])).normalize();
            let sight = at.iter().map(|point| point.coords).sum::<Vector3<f64>>().normalize();
            normal.dot(&sight)
        };
        let vertices = faces.min_by(|a, b| slope(a).total_cmp(&slope(b))).expect("six");
        Self { pose, size_m, vertices, rig }
    }

    fn corner(&self, vertex: usize) -> Point3<f64> {
        vertex_of(&self.pose, self.size_m, vertex)
    }

    fn centre(&self) -> Point3<f64> {
        let sum = self.vertices.iter().map(|vertex| self.corner(*vertex).coords);
        Point3::from(sum.sum::<Vector3<f64>>() * 0.25)
    }

    fn normal(&self) -> Vector3<f64> {
        (self.centre().coords - self.pose.translation.vector).normalize()
    }

    /// Whether a vertex belongs to a face that looks at the camera.
    fn shows(&self, vertex: usize) -> bool {
        (0..3).any(|axis| {
            let outward = self.pose.rotation
                * Vector3::ith(axis, if vertex & 1 << axis == 0 { -1.0 } else { 1.0 });
            outward.dot(&self.corner(vertex).coords) < 0.0
        })
    }

    /// The face, its corners and those of the rest of the cuboid off by Gaussian errors.
    fn face(&self, sigma_px: f64, knows_cuboid: bool, random: &mut Stream) -> Face {
        let covariance_px2 = Matrix2::identity() * sigma_px.max(0.01).powi(2);
        let mut seen = |vertex: usize| {
            let at = CAMERA.project(&self.corner(vertex)).expect("in front");
            let mut off = || sigma_px * random.normal();
            let point = ImagePoint::new(at.x + off(), at.y + off());
            SeenVertex { vertex, point, covariance_px2 }
        };
        let all: [SeenVertex; 8] = std::array::from_fn(&mut seen);
        let cuboid = SeenCuboid {
            vertices: std::array::from_fn(|vertex| self.shows(vertex).then_some(all[vertex])),
            face: self.vertices,
        };
        Face {
            corners: self.vertices.map(|vertex| all[vertex].point),
            covariances_px2: [Some(covariance_px2); 4],
            gap_fraction: 0.0,
            cuboid: knows_cuboid.then_some(cuboid),
            recognition: None,
        }
    }

    /// What a range sensor beside the camera sees: the cuboid alone.
    fn range(&self, cells: usize, noise_m: f64, random: &mut Stream) -> RangeImage {
        let camera = Camera { distortion: Distortion::NONE, ..CAMERA }.resized([cells, cells]);
        let camera_from_range =
            Pose::new(Vector3::new(0.02, 0.01, 0.0), Vector3::new(0.01, -0.02, 0.03));
        let cuboid_from_range = self.pose.inverse() * camera_from_range;
        let points = Plane::from_fn(cells, cells, |x, y| {
            #[allow(clippy::cast_precision_loss, reason = "small numbers")]
            let ray = camera.ray(ImagePoint::new(x as f64, y as f64));
            let (origin, along) =
                (cuboid_from_range.translation.vector, cuboid_from_range.rotation * ray);
            let (mut enters, mut leaves) = (f64::NEG_INFINITY, f64::INFINITY);
            for axis in 0..3 {
                let [a, b] =
                    [-0.5, 0.5].map(|side| (side * self.size_m[axis] - origin[axis]) / along[axis]);
                enters = enters.max(a.min(b));
                leaves = leaves.min(a.max(b));
            }
            let depth_m = enters + noise_m * random.normal();
            (enters < leaves).then(|| Point3::from(ray * depth_m))
        });
        RangeImage {
            camera,
            world_from_range: self.rig.world_from_camera * camera_from_range,
            points,
            noise: DepthNoise { noise_m, ..DepthNoise::default() },
        }
    }
}

fn estimate(name: &str, face: &Face, rig: &Rig, range: &RangeImage) -> Result<Grasp, NoGrasp> {
    let entry = ESTIMATORS.iter().find(|entry| entry.name == name).expect("registered");
    let estimator = (entry.build)("test", &Default::default()).expect("defaults");
    estimator.estimate(face, rig, range)
}

const WITH_APPROACH: [&str; 3] = ["cuboid_pose", "face_plane", "pose_and_plane"];

#[test]
fn true_corners_and_true_range_have_no_error() {
    let mut random = Stream::named(&["estimators", "exact"]);
    let mut counts = [0; 3];
    for round in 0..100 {
        let setup = Setup::any(&mut random);
        let range = setup.range(128, 0.0, &mut random);
        let face = setup.face(0.0, true, &mut random);
        for (name, count) in WITH_APPROACH.iter().zip(&mut counts) {
            let grasp = match estimate(name, &face, &setup.rig, &range) {
                Ok(grasp) => grasp,
                Err(NoGrasp::TooFewCells) => continue,
                Err(reason) => panic!("{round} {name}: {reason:?}"),
            };
            *count += 1;
            let off_mm = 1e3 * (grasp.point_in_camera - setup.centre()).norm();
            let approach = grasp.approach.expect("an approach");
            let turned_deg = approach.normal.angle(&setup.normal()).to_degrees();
            assert!(off_mm < 0.01 && turned_deg < 0.01, "{round} {name}: {off_mm} {turned_deg}");
            let sides = [0, 1]
                .map(|at| setup.corner(setup.vertices[at + 1]) - setup.corner(setup.vertices[at]));
            let shorter = if sides[0].norm() < sides[1].norm() { sides[0] } else { sides[1] };
            assert!((approach.opening_m - shorter.norm()).abs() < 1e-5, "{round} {name}");
            let between = approach.jaw.dot(&shorter.normalize()).abs();
            assert!(between > 1.0 - 1e-7, "{round} {name}: {between}");
            let world = setup.rig.world_from_camera * grasp.point_in_camera;
            assert!((world - grasp.point_in_world).norm() < 1e-12);
        }
    }
    assert!(counts[0] == 100 && counts[1] > 90 && counts[2] == 100, "{counts:?}");
}

#[test]
fn covariances_tell_how_far_points_are_off() {
    const ROUNDS: usize = 1500;
    for (name, knows_cuboid) in
        [("cuboid_pose", true), ("face_plane", false), ("pose_and_plane", true)]
    {
        let mut random = Stream::named(&["estimators", "covariance", name]);
        let (mut sum, mut count) = (0.0, 0);
        for _ in 0..ROUNDS {
            let setup = Setup::any(&mut random);
            let range = setup.range(64, 0.002, &mut random);
            let face = setup.face(0.1, knows_cuboid, &mut random);
            let Ok(grasp) = estimate(name, &face, &setup.rig, &range) else { continue };
            let error = grasp.point_in_camera - setup.centre();
            let information = grasp.covariance_m2.and_then(|covariance| covariance.try_inverse());
            sum += (error.transpose() * information.expect("a covariance") * error)[(0, 0)];
            count += 1;
        }
        // Three coordinates: 3 on average, of variance 6 each.
        let nees = sum / f64::from(count);
        let deviation = (6.0 / f64::from(count)).sqrt();
        assert!(count > 1400 && (nees - 3.0).abs() < 3.0 * deviation, "{name}: {nees} of {count}");
    }
}

#[test]
fn the_mean_of_corners_is_off_by_what_perspective_makes_of_it_and_the_diagonals_are_not() {
    // A square of 2a, tilted by t about x, at depth Z: f a^2 sin t cos t / (Z^2 - a^2 sin^2 t).
    for (a_m, z_m, tilt_deg) in
        [(0.025, 0.5, 45.0_f64), (0.1, 0.6, 45.0), (0.05, 0.8, 30.0), (0.05, 0.8, 60.0)]
    {
        let tilt = tilt_deg.to_radians();
        let camera =
            Camera { distortion: Distortion::NONE, fx_px: 1000.0, fy_px: 1000.0, ..CAMERA };
        let corners = [[-a_m, -a_m], [a_m, -a_m], [a_m, a_m], [-a_m, a_m]].map(|[x, y]| {
            let at = Point3::new(x, y * tilt.cos(), z_m + y * tilt.sin());
            camera.project(&at).expect("in front")
        });
        let face = Face::of_corners(corners, 0.0, &[]);
        let rig = Rig { camera, world_from_camera: Pose::identity(), object_size_m: None };
        let range = RangeImage {
            camera: camera.resized([32, 32]),
            world_from_range: Pose::identity(),
            points: Plane::from_fn(32, 32, |_, _| Some(Point3::new(0.0, 0.0, z_m))),
            noise: DepthNoise::default(),
        };
        let wanted_px =
            1000.0 * a_m * a_m * tilt.sin() * tilt.cos() / (z_m * z_m - (a_m * tilt.sin()).powi(2));
        let at = |name: &str| estimate(name, &face, &rig, &range).expect("a point").image_point;
        let mean = at("cell_at_corner_mean");
        let off_px = (camera.cy_px - mean.y).abs();
        assert!((off_px / wanted_px - 1.0).abs() < 0.02, "{off_px} px, not {wanted_px}");
        let diagonals = at("cell_at_diagonals");
        let centre = ImagePoint::new(camera.cx_px, camera.cy_px);
        assert!(diagonals.distance_px(centre) < 1e-9, "{diagonals:?}");
    }
}

#[test]
fn a_small_face_alone_is_ambiguous_and_range_decides() {
    let mut random = Stream::named(&["estimators", "ambiguous"]);
    let (mut ambiguous, mut right) = (0, 0);
    for _ in 0..100 {
        let tilt = Vector3::new(0.5, 0.3, 0.2 * random.uniform());
        let setup = Setup::of(Pose::new(Vector3::new(0.05, 0.02, 1.5), tilt), [0.05, 0.07, 0.06]);
        let rig = Rig { object_size_m: Some([0.05, 0.07, 0.06]), ..setup.rig };
        let face = setup.face(0.3, false, &mut random);
        ambiguous += usize::from(
            estimate("cuboid_pose", &face, &rig, &setup.range(128, 0.0, &mut random))
                == Err(NoGrasp::Ambiguous),
        );
        let range = setup.range(256, 0.0005, &mut random);
        if let Ok(grasp) = estimate("pose_and_plane", &face, &rig, &range) {
            let normal = grasp.approach.expect("an approach").normal;
            right += usize::from(normal.angle(&setup.normal()).to_degrees() < 5.0);
        }
    }
    assert!(ambiguous > 60 && right > 90, "{ambiguous} ambiguous, {right} right");
}

#[test]
fn a_small_face_alone_is_as_ambiguous_where_range_says_nothing() {
    let mut random = Stream::named(&["estimators", "blind"]);
    let mut ambiguous = 0;
    for _ in 0..100 {
        let tilt = Vector3::new(0.5, 0.3, 0.2 * random.uniform());
        let size_m = [0.05, 0.07, 0.06];
        let setup = Setup::of(Pose::new(Vector3::new(0.05, 0.02, 1.5), tilt), size_m);
        let rig = Rig { object_size_m: Some(size_m), ..setup.rig };
        let face = setup.face(0.3, false, &mut random);
        let range = setup.range(64, 0.0, &mut random);
        let nothing = RangeImage { points: Plane::filled(64, 64, None), ..range };
        let found = estimate("pose_and_plane", &face, &rig, &nothing);
        assert_eq!(found, estimate("cuboid_pose", &face, &rig, &nothing));
        ambiguous += usize::from(found == Err(NoGrasp::Ambiguous));
    }
    assert!(ambiguous > 60, "{ambiguous}");
}

#[test]
fn what_errs_five_times_as_much_as_it_says_is_believed_as_much_as_it_shows() {
    const ROUNDS: usize = 300;
    let mut random = Stream::named(&["estimators", "excess"]);
    for name in ["cuboid_pose", "face_plane"] {
        let (mut sum, mut count) = (0.0, 0);
        for _ in 0..ROUNDS {
            let setup = Setup::any(&mut random);
            let mut range = setup.range(64, 0.01, &mut random);
            range.noise.noise_m /= 5.0;
            let mut face = setup.face(0.5, true, &mut random);
            let vertices = face.cuboid.as_mut().map(|cuboid| cuboid.vertices.iter_mut());
            for seen in vertices.into_iter().flatten().flatten() {
                seen.covariance_px2 /= 25.0;
            }
            let Ok(grasp) = estimate(name, &face, &setup.rig, &range) else { continue };
            let error = grasp.point_in_camera - setup.centre();
            let information = grasp.covariance_m2.and_then(|covariance| covariance.try_inverse());
            sum += (error.transpose() * information.expect("a covariance") * error)[(0, 0)];
            count += 1;
        }
        // Where the scale is found of few numbers it scatters; believed, errors would make it 75.
        let nees = sum / f64::from(count);
        assert!(count > 250 && (2.0..8.0).contains(&nees), "{name}: {nees} of {count}");
    }
}

#[test]
fn what_is_not_known_is_said() {
    let mut random = Stream::named(&["estimators", "unknown"]);
    let setup = Setup::any(&mut random);
    let face = setup.face(0.1, true, &mut random);
    let range = setup.range(64, 0.0, &mut random);
    let nothing = RangeImage { points: Plane::filled(64, 64, None), ..range.clone() };
    let no_size = Rig { object_size_m: None, ..setup.rig };
    let other = Rig { object_size_m: Some([0.5, 0.02, 0.1]), ..setup.rig };
    assert_eq!(estimate("cuboid_pose", &face, &no_size, &range), Err(NoGrasp::NoSize));
    assert_eq!(estimate("pose_and_plane", &face, &no_size, &range), Err(NoGrasp::NoSize));
    assert_eq!(estimate("cuboid_pose", &face, &other, &range), Err(NoGrasp::NoPose));
    assert_eq!(estimate("face_plane", &face, &setup.rig, &nothing), Err(NoGrasp::TooFewCells));
    assert_eq!(estimate("cell_at_diagonals", &face, &setup.rig, &nothing), Err(NoGrasp::NoRange));
    // Without range the pose of the corners is what there is.
    assert!(estimate("pose_and_plane", &face, &setup.rig, &nothing).is_ok());
}

#[test]
fn corners_and_a_range_that_tells_of_something_else_are_no_grasp() {
    let mut random = Stream::named(&["estimators", "contradiction"]);
    for _ in 0..20 {
        let setup = Setup::any(&mut random);
        let face = setup.face(0.1, true, &mut random);
        let range = setup.range(64, 0.0, &mut random);
        assert!(estimate("pose_and_plane", &face, &setup.rig, &range).is_ok());
        // Something before the face, of which nothing but range tells.
        let nearer = range.points.map(|point| point.map(|point| Point3::from(0.7 * point.coords)));
        let other = RangeImage { points: nearer, ..range };
        let found = estimate("pose_and_plane", &face, &setup.rig, &other);
        assert_eq!(found, Err(NoGrasp::Contradictory));
    }
}

/// A plan that grasps by every way from corners to a face and on to a grasp.
const PLAN: &str = "camera = 'ideal'
[[pipelines]]
name = 'grasp'
target = 'red_difference'
detect = { algorithm = 'harris', threshold_rel = 0.001 }
refine = ['corner_sub_pix', 'junction_fit']
face = ['cuboid_faces', 'least_occluded']
grasp = ['cell_at_corner_mean', 'cuboid_pose', 'face_plane', 'pose_and_plane']
";

#[test]
fn a_rendered_cuboid_is_grasped_where_it_is_from_its_picture_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (recipes_folder, output) = (folder.path().join("recipes"), folder.path().join("run"));
    copy_folder(&recipes(), &recipes_folder);
    fs::write(recipes_folder.join("plans/own.toml"), PLAN).expect("written");
    let mut measure = cornerbench();
    measure.args(["measure", "own", "--quiet", "--no-timing", "--recipes"]).arg(&recipes_folder);
    let said = succeed(measure.arg(plain_dataset()).arg("-o").arg(&output));
    assert!(said.contains("10 mm, 10\u{b0}") && said.contains("NEES"), "{said}");
    let records = read_records(&output.join("records.parquet")).expect("records");
    let of = |method: &str| {
        let is_its = |row: &&Record| {
            row.kind == kind::GRASP && row.scene == "oblique" && row.method == method
        };
        records.iter().find(is_its).expect("a row")
    };
    for refiner in ["corner_sub_pix", "junction_fit"] {
        for estimator in ["cuboid_pose", "face_plane", "pose_and_plane"] {
            let row = of(&format!("grasp-{refiner}-cuboid_faces-{estimator}"));
            assert_eq!(row.face_is_right, Some(true), "{row:?}");
            let most_mm = if refiner == "junction_fit" { 1.0 } else { 12.0 };
            let error_mm = row.grasp_error_mm.expect("a grasp");
            assert!(error_mm < most_mm, "{refiner} {estimator}: {error_mm} mm");
            // What of the error is in the face and across it makes all of it.
            let parts = [row.grasp_in_face_error_mm, row.grasp_normal_error_mm];
            let [in_face, normal] = parts.map(|part| part.expect("a part"));
            assert!((in_face.hypot(normal) - error_mm).abs() < 1e-9, "{row:?}");
            if refiner == "junction_fit" {
                let degrees = [row.approach_error_deg, row.jaw_error_deg];
                assert!(degrees.iter().all(|error| error.is_some_and(|deg| deg < 0.5)), "{row:?}");
            }
        }
    }
    // The whole cuboid, whatever its axes are called.
    let row = of("grasp-junction_fit-cuboid_faces-pose_and_plane");
    assert!(row.pose_mssd_mm.is_some_and(|mm| mm < 1.0), "{row:?}");
    assert!(row.pose_add_s_mm <= row.pose_add_mm && row.pose_add_mm <= row.pose_mssd_mm);
    let paper = of("grasp-corner_sub_pix-cuboid_faces-cell_at_corner_mean");
    assert!(paper.grasp_error_mm > row.grasp_error_mm && paper.approach_world_x.is_none());
}

#[test]
fn true_corners_of_a_rendered_cuboid_and_its_true_range_have_no_error() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (recipes_folder, output) = (folder.path().join("recipes"), folder.path().join("run"));
    copy_folder(&recipes(), &recipes_folder);
    let plan = "camera = 'ideal'
        [[pipelines]]
        name = 'moved'
        seeds.disc_px = [0, 1]
        grasp = ['cell_at_corner_mean', 'cuboid_pose', 'face_plane', 'pose_and_plane']";
    fs::write(recipes_folder.join("plans/own.toml"), plan).expect("written");
    let mut measure = cornerbench();
    measure.args(["measure", "own", "--quiet", "--recipes"]).arg(&recipes_folder);
    succeed(measure.arg(plain_dataset()).arg("-o").arg(&output));
    let records = read_records(&output.join("records.parquet")).expect("records");
    let of = |method: &str| -> Vec<&Record> {
        let is_its = |row: &&Record| row.kind == kind::GRASP && row.method == method;
        let rows = records.iter().filter(is_its).filter(|row| row.status == "ok");
        rows.collect()
    };
    for estimator in ["cuboid_pose", "face_plane", "pose_and_plane"] {
        let exact = of(&format!("moved-disc_px=0-{estimator}"));
        assert!(!exact.is_empty(), "{estimator}");
        for row in exact {
            assert_eq!(row.face_is_right, Some(true), "{row:?}");
            assert_eq!(row.face_selector.as_deref(), Some("given"));
            let errors = [row.grasp_error_mm, row.approach_error_deg, row.jaw_error_deg];
            assert!(errors.iter().all(|error| error.is_some_and(|error| error < 0.01)), "{row:?}");
            assert!(row.pose_mssd_mm.is_none_or(|mm| mm < 0.01), "{row:?}");
        }
        let moved = of(&format!("moved-disc_px=1-{estimator}"));
        assert!(moved.iter().all(|row| row.grasp_error_mm > Some(0.1)), "{estimator}");
    }
    // The mean of true corners is no centre, and a cell not its depth; yet what it sees is on the face.
    let cells = of("moved-disc_px=0-cell_at_corner_mean");
    assert!(cells.iter().any(|row| row.grasp_error_mm > Some(1.0)));
    for row in cells {
        let parts = [row.grasp_in_face_error_mm, row.grasp_normal_error_mm];
        let [in_face, normal] = parts.map(|part| part.expect("a part").abs());
        assert!(normal < 0.1 * in_face, "{row:?}");
    }
}
