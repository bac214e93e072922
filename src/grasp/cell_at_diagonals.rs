//! The range cell at the intersection of a face's diagonals.
//!
//! ```text
//! # Method      u = (p0 x p2) x (p1 x p3), lens undone: what the face's centre is seen at, whatever the perspective;
//!               X = the point on the ray through u at the depth of the range cell whose ray is nearest to it.
//! # Input       a face; the colour camera and its pose; a range image and its sensor's pose.
//! # Parameters  lookup  ray   as of cell_at_corner_mean
//! # Output      u [px], X in the camera frame and in the world [m]; no_range where the cell is empty, or the corners
//!               are no quadrilateral.
//! # Border      beyond the range image, the nearest cell of its border.
//! # Cost        O(1).
//! # Departures  the paper takes the mean of the corners (cell_at_corner_mean). With noise of sigma in each coordinate
//!               of a square's corners the mean has variance sigma^2 / 4, the intersection sigma^2 / 2: where the face
//!               is neither tilted nor near the mean is the better one.
//! # Source      the cross ratio of four points on a line: any text on projective geometry; Hartley & Zisserman,
//!               Multiple View Geometry, 2004, chapter 2.
//! # Checked by  tests/it/estimators.rs
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::grasp::cells::Lookup;
use crate::grasp::face_plane::diagonal_ray;
use crate::grasp::{Face, Grasp, GraspEstimator, NoGrasp};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::{RangeImage, Rig};

/// The registry's line.
pub const ENTRY: Entry<dyn GraspEstimator> = Entry {
    name: "cell_at_diagonals",
    summary: "the range cell nearest to where the face's diagonals meet",
    reference: "Hartley & Zisserman 2004, chapter 2",
    version: 1,
    defaults: defaults::<CellAtDiagonals>,
    schema: schema::<CellAtDiagonals>,
    build: |place, table| Ok(Box::new(parameters::<CellAtDiagonals>(place, table)?)),
};

/// The estimator; its parameter is that of the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct CellAtDiagonals {
    /// What is taken from the range cell.
    pub lookup: Lookup,
}

impl Default for CellAtDiagonals {
    fn default() -> Self {
        Self { lookup: Lookup::Ray }
    }
}

impl GraspEstimator for CellAtDiagonals {
    fn estimate(&self, face: &Face, rig: &Rig, range: &RangeImage) -> Result<Grasp, NoGrasp> {
        let ray = diagonal_ray(&face.corners, rig).ok_or(NoGrasp::NoRange)?;
        let image_point = rig.camera.project(&ray.into()).ok_or(NoGrasp::NoRange)?;
        self.lookup.at(image_point, rig, range)
    }
}
