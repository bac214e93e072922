//! Options of pictures of one's own: what is known of them.

use std::ops::Bound;
use std::path::PathBuf;

use super::{Global, project};
use crate::error::Result;
use crate::geometry::Origin;
use crate::picture::Making;
use crate::plan::read_camera;
use crate::registry;
use crate::sensor::{Photographer, Transfer};

/// What is said where no camera is named.
pub(super) const NO_CAMERA: &str = "covariances assume that samples are rounded and free of other noise; --camera NAME takes a camera's";

#[derive(clap::Args)]
#[command(next_help_heading = "Pictures of one's own")]
pub(super) struct PictureOptions {
    /// A CSV or JSON file of the corners that are known in them: columns or keys image, x_px, y_px, index, name.
    #[arg(long, value_name = "FILE")]
    pub known: Option<PathBuf>,
    /// What coordinates in files count from; the centre of the top-left pixel where this is not given.
    #[arg(long, value_enum, value_name = "ORIGIN")]
    origin: Option<Origin>,
    /// The curve from light to samples: linear, srgb, or gamma2.2 and the like; sRGB of whole
    /// numbers, linear of floats, where this is not given.
    #[arg(long, value_name = "CURVE", value_parser = parse_transfer, conflicts_with = "camera")]
    transfer: Option<Transfer>,
    /// Of linear floats the value of full scale; just above a picture's brightest sample where this
    /// is not given.
    #[arg(long, value_name = "VALUE", conflicts_with = "camera")]
    white: Option<f64>,
    /// The camera that took them: its curve, black level, noise and mosaic; `cornerbench list cameras`
    /// names some.
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
}

impl PictureOptions {
    /// What coordinates in files count from.
    pub fn origin(&self) -> Origin {
        self.origin.unwrap_or_default()
    }

    /// The first of them that was given.
    pub fn given(&self) -> Option<&'static str> {
        let given = [
            ("--known", self.known.is_some()),
            ("--origin", self.origin.is_some()),
            ("--transfer", self.transfer.is_some()),
            ("--white", self.white.is_some()),
            ("--camera", self.camera.is_some()),
        ];
        given.into_iter().find_map(|(name, is_given)| is_given.then_some(name))
    }

    /// The camera that is named.
    ///
    /// # Errors
    /// When there is none of the name, or --white is out of range.
    pub fn read_camera(&self, global: &Global) -> Result<Option<Photographer>> {
        if let Some(white) = self.white {
            let above_zero = (Bound::Excluded(0.0), Bound::Included(1e9));
            registry::in_range("command line", "--white", white, above_zero)?;
        }
        let Some(name) = &self.camera else { return Ok(None) };
        read_camera(&project::recipes(global)?, name).map(Some)
    }

    /// What is known of how pictures came to be.
    pub fn making<'a>(&self, camera: Option<&'a Photographer>) -> Making<'a> {
        Making { camera, transfer: self.transfer, white: self.white }
    }
}

fn parse_transfer(text: &str) -> std::result::Result<Transfer, String> {
    let gamma = |text: &str| text.strip_prefix("gamma")?.parse().ok();
    match (text, gamma(text)) {
        ("linear", _) => Ok(Transfer::Linear),
        ("srgb", _) => Ok(Transfer::Srgb),
        (_, Some(gamma)) if (1.0..=4.0).contains(&gamma) => Ok(Transfer::Power { gamma }),
        _ => Err("must be linear, srgb, or gamma and a number in [1, 4]: gamma2.2".to_owned()),
    }
}
