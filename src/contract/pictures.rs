//! Drawn pictures whose corners are known, and how they are moved.

use std::f64::consts::{FRAC_PI_2, TAU};

use rayon::prelude::*;

use crate::error::Result;
use crate::geometry::{Camera, Distortion, ImagePoint};
use crate::image::Plane;
use crate::junction::BlurredJunction;
use crate::random::Stream;
use crate::sensor::{Encoding, Exposure, Transfer};

/// Junctions stand in squares of this side \[px\], each drawn by itself,
const TILE_PX: usize = 40;
/// so many in a row and in a column,
const TILES: [usize; 2] = [4, 3];
/// and so far from a square's middle \[px\]: x and y cannot be taken for each other.
const OFF_MIDDLE_PX: [f64; 2] = [4.0, -4.0];
/// Blur of the edges \[px\].
const SIGMA_PX: f64 = 0.7;
/// A picture's size \[px\].
pub(super) const SIZE_PX: [usize; 2] = [TILE_PX * TILES[0], TILE_PX * TILES[1]];

/// A picture and its corners.
pub(super) struct Picture {
    pub exposure: Exposure,
    pub corners: Vec<ImagePoint>,
}

impl Picture {
    /// Pictures of Ls, Ys and Xs, each four times, turned by a quarter: what an algorithm errs into a corner's angle adds
    /// up to nothing.
    ///
    /// # Errors
    /// Never: samples are finite.
    pub fn all(count: usize) -> Result<Vec<Self>> {
        (0..count).into_par_iter().map(Self::new).collect()
    }

    fn new(number: usize) -> Result<Self> {
        let mut random = Stream::named(&["contract", &number.to_string()]);
        let places: Vec<[f64; 2]> =
            (0..TILES[0] * TILES[1]).map(|_| [random.uniform(), random.uniform()]).collect();
        let kinds: Vec<[f64; 2]> =
            (0..TILES[1]).map(|_| [TAU * random.uniform(), random.uniform()]).collect();
        let junctions: Vec<BlurredJunction> = places
            .iter()
            .enumerate()
            .map(|(tile, [right, down])| {
                let middle = 0.5 * TILE_PX as f64 - 0.5;
                let [x, y] = OFF_MIDDLE_PX.map(|off| middle + off - 0.5);
                let vertex = ImagePoint::new(x + right, y + down);
                let (kind, turn) = (tile / TILES[0], tile % TILES[0]);
                let [first, share] = kinds[kind];
                junction(kind, vertex, first + FRAC_PI_2 * turn as f64, share)
            })
            .collect();
        let plane = Plane::from_fn(SIZE_PX[0], SIZE_PX[1], |x, y| {
            let junction = &junctions[y / TILE_PX * TILES[0] + x / TILE_PX];
            let value = over_pixel(junction, x % TILE_PX, y % TILE_PX);
            #[allow(clippy::cast_possible_truncation, reason = "0 to 255")]
            let sample = value.round() as f32;
            sample
        });
        let corners = junctions.iter().enumerate().map(|(tile, junction)| {
            let [x, y] = [tile % TILES[0], tile / TILES[0]].map(|place| (place * TILE_PX) as f64);
            ImagePoint::new(x + junction.vertex.x, y + junction.vertex.y)
        });
        let corners = corners.collect();
        Ok(Self { exposure: grey(plane)?, corners })
    }
}

fn junction(kind: usize, vertex: ImagePoint, first_rad: f64, share: f64) -> BlurredJunction {
    let opening_rad = (70.0 + 50.0 * share).to_radians();
    match kind {
        0 => BlurredJunction::l(vertex, [first_rad, opening_rad], [210.0, 60.0], SIGMA_PX),
        1 => {
            let edges_rad = [first_rad, first_rad + opening_rad, first_rad + opening_rad + 2.0];
            BlurredJunction::y_or_arrow(vertex, edges_rad, [210.0, 130.0, 60.0], SIGMA_PX)
        }
        _ => BlurredJunction::x(vertex, [first_rad, opening_rad], [210.0, 60.0], SIGMA_PX),
    }
}

/// The mean over a pixel, from nine places: to a hundredth of a step of 8 bits.
fn over_pixel(junction: &BlurredJunction, x: usize, y: usize) -> f64 {
    // Gauss and Legendre's nodes and weights on a pixel.
    const NODES: [(f64, f64); 3] = [
        (-0.387_298_334_620_741_7, 5.0 / 18.0),
        (0.0, 8.0 / 18.0),
        (0.387_298_334_620_741_7, 5.0 / 18.0),
    ];
    let mut sum = 0.0;
    for (down, of_row) in NODES {
        for (right, of_column) in NODES {
            sum += of_row * of_column * junction.value(x as f64 + right, y as f64 + down);
        }
    }
    sum
}

/// A grey exposure of 8 bits, of a camera and a target that are known.
pub(super) fn grey(plane: Plane<f32>) -> Result<Exposure> {
    let [width, height] = [plane.width(), plane.height()];
    let encoding = Encoding { bit_depth: 8, transfer: Transfer::Linear, black_dn: 0.0 };
    let exposure = Exposure::new([plane.clone(), plane.clone(), plane], encoding)?;
    #[allow(clippy::cast_possible_truncation, reason = "drawn here")]
    let camera = Camera {
        width: width as u32,
        height: height as u32,
        fx_px: 1000.0,
        fy_px: 1000.0,
        cx_px: 0.5 * (width as f64 - 1.0),
        cy_px: 0.5 * (height as f64 - 1.0),
        distortion: Distortion::NONE,
    };
    Ok(exposure.with_camera(camera).with_object_size([0.2, 0.12, 0.08]))
}

/// How a picture and its points are changed, and points that were answered changed back.
pub(super) struct Motion {
    /// What is done: "turned by a quarter".
    pub words: &'static str,
    plane: fn(&Plane<f32>) -> Plane<f32>,
    point: fn(ImagePoint) -> ImagePoint,
}

/// By how many pixels pictures are moved.
const SHIFT: [usize; 2] = [13, 7];

impl Motion {
    /// By whole pixels, and by a quarter turn.
    pub const ALL: [Self; 2] = [
        Self {
            words: "moved by whole pixels",
            plane: |plane| {
                let [right, down] = SHIFT;
                Plane::from_fn(plane.width() + right, plane.height() + down, |x, y| {
                    plane.at(x.saturating_sub(right), y.saturating_sub(down))
                })
            },
            point: |point| ImagePoint::new(point.x + SHIFT[0] as f64, point.y + SHIFT[1] as f64),
        },
        Self {
            words: "turned by a quarter",
            plane: |plane| {
                let [width, height] = [plane.width(), plane.height()];
                Plane::from_fn(height, width, |x, y| plane.at(y, height - 1 - x))
            },
            point: |point| ImagePoint::new(SIZE_PX[1] as f64 - 1.0 - point.y, point.x),
        },
    ];

    /// Changes no place, only samples: by a factor, in steps as fine as the samples allow.
    pub const GAIN: Self = Self {
        words: "darker by a fifth",
        plane: |plane| plane.map(|sample| (0.8 * sample).round()),
        point: |point| point,
    };

    pub fn picture(&self, exposure: &Exposure) -> Result<Exposure> {
        grey((self.plane)(&exposure.rgb()[0]))
    }

    pub fn point(&self, point: ImagePoint) -> ImagePoint {
        (self.point)(point)
    }
}

/// Pictures that hold next to nothing, each with its name.
///
/// # Errors
/// Never: samples are finite.
pub(super) fn degenerate() -> Result<Vec<(&'static str, Exposure)>> {
    let mut random = Stream::named(&["contract", "noise"]);
    let noise = Plane::from_fn(48, 32, |_, _| {
        #[allow(clippy::cast_possible_truncation, reason = "0 to 255")]
        let sample = (255.0 * random.uniform()).round() as f32;
        sample
    });
    [
        ("one pixel", Plane::filled(1, 1, 9.0)),
        ("one row", Plane::from_fn(64, 1, |x, _| (x % 7) as f32)),
        ("three pixels square", Plane::filled(3, 3, 128.0)),
        ("nothing but grey", Plane::filled(64, 48, 128.0)),
        ("black", Plane::filled(64, 48, 0.0)),
        ("full scale", Plane::filled(64, 48, 255.0)),
        ("noise alone", noise),
    ]
    .into_iter()
    .map(|(name, plane)| Ok((name, grey(plane)?)))
    .collect()
}

/// An edge without a corner, aslant.
///
/// # Errors
/// Never: samples are finite.
pub(super) fn edge() -> Result<Exposure> {
    grey(Plane::from_fn(64, 48, |x, y| {
        let far = 0.8 * (x as f64 - 31.3) + 0.6 * (y as f64 - 23.2);
        #[allow(clippy::cast_possible_truncation, reason = "0 to 255")]
        let sample = (135.0 + 75.0 * libm::erf(far / SIGMA_PX)).round() as f32;
        sample
    }))
}
