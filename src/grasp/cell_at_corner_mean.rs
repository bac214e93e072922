//! The range cell at the mean of a face's corners.
//!
//! ```text
//! # Method      u = (p0 + p1 + p2 + p3) / 4;  X = the point of the range cell whose ray is nearest
//!               to the ray through u;  X_world = world_from_range * X.
//! # Input       a face; the colour camera and its pose; a range image and its sensor's pose.
//! # Parameters  lookup  cell   cell: X is the cell's own point, as in the source;
//!                              ray: X is the point on the ray through u at the depth of the
//!                              cell's point in the camera frame
//! # Output      u [px], X in the camera frame and in the world [m]; no_range where the cell is
//!               empty.
//! # Border      beyond the range image, the nearest cell of its border.
//! # Cost        O(1).
//! # Departures  none with cell; ray is ours. The source calls its points approximate; they are so
//!               twice. The mean of the corners is not the image of the face's centre: it errs
//!               towards the near side by
//!                 f a^2 sin t cos t / (Z^2 - a^2 sin^2 t) px
//!               (length 2a, tilt t, depth Z, focal length f): 14 px = 8 mm for a = 100 mm,
//!               Z = 0.6 m, t = 45 deg, f = 1000 px. And a cell of the source's 32 x 32 sensor
//!               covers 16 x 16 px: its point lies up to 8 px in x and y beside u, perhaps on
//!               another face (ray removes the sideways error, not the error in depth).
//! # Source      Visual recognition of robot targets in complex state based on sub-pixel Harris
//!               corner, section 5.
//! # Checked by  tests below (hand numbers)
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::ImagePoint;
use crate::grasp::cells::Lookup;
use crate::grasp::{Face, Grasp, GraspEstimator, NoGrasp};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::{RangeImage, Rig};

/// The registry's line.
pub const ENTRY: Entry<dyn GraspEstimator> = Entry {
    name: "cell_at_corner_mean",
    summary: "the range cell nearest to the mean of the face's four corners",
    reference: "Visual recognition of robot targets in complex state based on sub-pixel Harris \
                corner, section 5",
    version: 1,
    defaults: defaults::<CellAtCornerMean>,
    schema: schema::<CellAtCornerMean>,
    build: |place, table| Ok(Box::new(parameters::<CellAtCornerMean>(place, table)?)),
};

/// The estimator; its parameter is that of the header.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct CellAtCornerMean {
    /// What is taken from the range cell.
    pub lookup: Lookup,
}

impl GraspEstimator for CellAtCornerMean {
    fn estimate(
        &self,
        face: &Face,
        rig: &Rig,
        range: &RangeImage,
    ) -> std::result::Result<Grasp, NoGrasp> {
        self.lookup.at(mean(&face.corners), rig, range)
    }
}

fn mean(corners: &[ImagePoint; 4]) -> ImagePoint {
    let sum = |value: fn(&ImagePoint) -> f64| corners.iter().map(value).sum::<f64>();
    ImagePoint::new(0.25 * sum(|p| p.x), 0.25 * sum(|p| p.y))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Point3, Vector3};

    use super::*;
    use crate::geometry::Camera;
    use crate::image::Plane;

    /// A colour camera of 64 x 64 pixels over a range image of 4 x 4 cells.
    fn rig() -> Rig {
        let camera = Camera::pinhole(64, 64, 32.0);
        // A metre up and looking down: x stays, y and z turn over.
        let turn = Isometry3::rotation(Vector3::x() * std::f64::consts::PI);
        let world_from_camera = Isometry3::translation(0.0, 0.0, 1.0) * turn;
        Rig { camera, world_from_camera, object_size_m: None }
    }

    /// Depth 1 m wherever there is an answer; cell (3, 3) has none.
    fn range() -> RangeImage {
        let camera = Camera::pinhole(4, 4, 2.0);
        #[allow(clippy::cast_precision_loss, reason = "small numbers")]
        let points = Plane::from_fn(4, 4, |x, y| {
            ((x, y) != (3, 3)).then(|| camera.unproject(ImagePoint::new(x as f64, y as f64), 1.0))
        });
        RangeImage {
            camera,
            world_from_range: rig().world_from_camera,
            points,
            noise: crate::sensor::DepthNoise::default(),
        }
    }

    fn square_at(x: f64, y: f64) -> Face {
        let corners =
            [[x - 2.0, y - 2.0], [x + 2.0, y - 2.0], [x + 2.0, y + 2.0], [x - 2.0, y + 2.0]]
                .map(ImagePoint::from);
        Face::of_corners(corners, 0.0, &[])
    }

    fn estimate(parameters: &str, face: &Face) -> std::result::Result<Grasp, NoGrasp> {
        let table = parameters.parse().expect("valid TOML");
        let estimator = (ENTRY.build)("test", &table).expect("valid parameters");
        estimator.estimate(face, &rig(), &range())
    }

    #[test]
    fn the_cell_answers_with_its_own_point() {
        // (41.5, 25.5) looks along (10/32, -6/32): cell (1.5 + 0.625, 1.5 - 0.375) = (2, 1), whose
        // own ray is (0.25, -0.25). The world is the camera turned over, a metre higher.
        let grasp = estimate("", &square_at(41.5, 25.5)).expect("range");
        assert!((grasp.image_point.x - 41.5).abs() < 1e-12);
        assert!((grasp.image_point.y - 25.5).abs() < 1e-12);
        assert!((grasp.point_in_camera - Point3::new(0.25, -0.25, 1.0)).norm() < 1e-12);
        assert!((grasp.point_in_world - Point3::new(0.25, 0.25, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn the_ray_keeps_the_image_point_and_takes_the_depth() {
        let grasp = estimate("lookup = \"ray\"", &square_at(41.5, 25.5)).expect("range");
        assert!((grasp.point_in_camera - Point3::new(0.3125, -0.1875, 1.0)).norm() < 1e-12);
        assert!((grasp.point_in_world - Point3::new(0.3125, 0.1875, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn a_sensor_with_a_pose_of_its_own_answers_in_its_own_frame() {
        // Half a metre to the right of the camera and as much nearer to the ground: its cell (2, 1)
        // sees the same direction, so a point half a metre off.
        let mut elsewhere = range();
        elsewhere.world_from_range =
            Isometry3::translation(0.5, 0.0, -0.5) * rig().world_from_camera;
        let ask = |lookup| {
            let estimator = CellAtCornerMean { lookup };
            estimator.estimate(&square_at(41.5, 25.5), &rig(), &elsewhere).expect("range")
        };
        let cell = ask(Lookup::Cell);
        assert!((cell.point_in_world - Point3::new(0.75, 0.25, -0.5)).norm() < 1e-12, "{cell:?}");
        assert!((cell.point_in_camera - Point3::new(0.75, -0.25, 1.5)).norm() < 1e-12, "{cell:?}");
        let ray = ask(Lookup::Ray);
        let expected = Point3::new(0.468_75, -0.281_25, 1.5);
        assert!((ray.point_in_camera - expected).norm() < 1e-12, "{ray:?}");
    }

    #[test]
    fn an_empty_cell_is_no_range() {
        assert_eq!(estimate("", &square_at(60.0, 60.0)), Err(NoGrasp::NoRange));
        assert_eq!(estimate("lookup = \"ray\"", &square_at(900.0, 900.0)), Err(NoGrasp::NoRange));
    }

    #[test]
    fn a_range_image_without_cells_is_no_range() {
        let empty = RangeImage { points: Plane::filled(0, 0, None), ..range() };
        let answer = CellAtCornerMean::default().estimate(&square_at(30.0, 30.0), &rig(), &empty);
        assert_eq!(answer, Err(NoGrasp::NoRange));
    }

    #[test]
    fn an_unknown_lookup_names_the_known_ones() {
        let table = "lookup = \"beam\"".parse().expect("valid TOML");
        let error = (ENTRY.build)("plan.toml: [grasp]", &table).err().expect("unknown");
        let said = error.to_string();
        assert!(said.contains("lookup") && said.contains("`cell` or `ray`"), "{said}");
    }
}
