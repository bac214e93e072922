//! What other people's coordinates count from.

use serde::{Deserialize, Serialize};

use crate::stats::{mean, median, standard_error};

use super::ImagePoint;

/// What a file's coordinates count from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Origin {
    /// (0, 0) is the centre of the top-left pixel, as in OpenCV and here.
    #[default]
    PixelCentre,
    /// (0, 0) is the top-left corner of the top-left pixel, whose centre is (0.5, 0.5).
    PixelCorner,
    /// (1, 1) is the centre of the top-left pixel.
    Matlab,
}

/// What answers look like that are off by so much \[px\], where another origin explains it to `near_px` in x and in y.
pub fn shift_words([dx, dy]: [f64; 2], near_px: [f64; 2]) -> Option<&'static str> {
    const KNOWN: [(f64, &str); 4] = [
        (
            0.5,
            "answers look shifted by (+0.5, +0.5) px: they count from the pixel's corner; subtract 0.5 from x and y",
        ),
        (-0.5, "answers look shifted by (-0.5, -0.5) px: half a pixel is taken off once too often"),
        (1.0, "answers look shifted by (+1, +1) px: they count from 1; subtract 1 from x and y"),
        (-1.0, "answers look shifted by (-1, -1) px: 1 is taken off once too often"),
    ];
    let explains = |by_px: f64| (dx - by_px).abs() < near_px[0] && (dy - by_px).abs() < near_px[1];
    KNOWN.into_iter().find_map(|(by_px, words)| explains(by_px).then_some(words))
}

impl Origin {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::PixelCentre, Self::PixelCorner, Self::Matlab];

    /// Both coordinates of the top-left pixel's centre \[px\].
    pub fn first_centre_px(self) -> f64 {
        match self {
            Self::PixelCentre => 0.0,
            Self::PixelCorner => 0.5,
            Self::Matlab => 1.0,
        }
    }

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::PixelCentre => "pixel-centre",
            Self::PixelCorner => "pixel-corner",
            Self::Matlab => "matlab",
        }
    }

    /// What known corners look as if they were counted from, where that is this, and what to try.
    pub fn note(self) -> String {
        let from = match self {
            Self::PixelCorner => "the pixel's corner",
            Self::Matlab => "(1, 1) at the first pixel's centre",
            Self::PixelCentre => "the first pixel's centre",
        };
        let name = self.name();
        format!("your known corners look as if counted from {from}; try --origin {name}")
    }

    /// A point of a file that counts from here.
    pub fn point(self, [x, y]: [f64; 2]) -> ImagePoint {
        ImagePoint::new(x - self.first_centre_px(), y - self.first_centre_px())
    }

    /// The origin from which known points look as if counted, where it is not the one that they were read with, from
    /// answers less known points \[px\] of several methods: the middle one of the methods' means would be explained by it
    /// to 0.15 px. A method of fewer than four answers, or whose mean is not known to a tenth of a pixel, says nothing.
    pub fn likely(offsets_of_methods: &[Vec<[f64; 2]>], read_with: Self) -> Option<Self> {
        let of_axis = |offsets: &[[f64; 2]], axis: usize| -> Vec<f64> {
            offsets.iter().map(|offset| offset[axis]).collect()
        };
        let is_certain = |offsets: &&Vec<[f64; 2]>| {
            let is_known = |axis| standard_error(&of_axis(offsets, axis)).is_some_and(|e| e < 0.1);
            offsets.len() >= 4 && is_known(0) && is_known(1)
        };
        let means = offsets_of_methods
            .iter()
            .filter(is_certain)
            .filter_map(|offsets| Some([mean(&of_axis(offsets, 0))?, mean(&of_axis(offsets, 1))?]));
        let means: Vec<[f64; 2]> = means.collect();
        let [dx, dy] = [median(&of_axis(&means, 0))?, median(&of_axis(&means, 1))?];
        let explains = |origin: &Self| {
            let shift = origin.first_centre_px() - read_with.first_centre_px();
            (dx + shift).abs() < 0.15 && (dy + shift).abs() < 0.15
        };
        Self::ALL.into_iter().find(|origin| *origin != read_with && explains(origin))
    }
}
