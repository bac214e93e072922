//! One range cell, looked up at an image point: what the paper does.

use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::ImagePoint;
use crate::grasp::{Grasp, NoGrasp};
use crate::sensor::{RangeImage, Rig};

/// What is taken from the range cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Lookup {
    /// Its point.
    #[default]
    Cell,
    /// Its depth, on the ray through the image point.
    Ray,
}

impl Lookup {
    /// The grasp point that the cell nearest to an image point tells.
    pub(super) fn at(
        self,
        image_point: ImagePoint,
        rig: &Rig,
        range: &RangeImage,
    ) -> Result<Grasp, NoGrasp> {
        let (x, y) = range.nearest_cell(rig, image_point).ok_or(NoGrasp::NoRange)?;
        let cell: Point3<f64> = range.points.at(x, y).ok_or(NoGrasp::NoRange)?;
        let cell_in_camera = rig.world_from_camera.inverse() * (range.world_from_range * cell);
        let point_in_camera = match self {
            Self::Cell => cell_in_camera,
            Self::Ray => rig.camera.unproject(image_point, cell_in_camera.z),
        };
        Ok(Grasp::at(image_point, point_in_camera, rig))
    }
}
