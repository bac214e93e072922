//! A mosaic of colour filters, red, green / green, blue, and colours made of it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::image::Plane;

/// How full colour is made of a mosaic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Demosaic {
    /// Not at all: one plane of raw samples.
    Raw,
    /// Means of the nearest samples of a colour.
    Bilinear,
    /// Malvar, He & Cutler (2004), High-quality linear interpolation for demosaicing of
    /// Bayer-patterned color images: bilinear, corrected by the gradient of the colour that is there.
    #[default]
    Malvar,
}

impl Demosaic {
    /// How far away samples may lie that a pixel is made of \[px\].
    pub(super) fn reach(self) -> usize {
        match self {
            Self::Raw => 0,
            Self::Bilinear => 1,
            Self::Malvar => 2,
        }
    }
}

/// The colour of the filter on a pixel: 0 red, 1 green, 2 blue.
pub(super) fn filter(x: usize, y: usize) -> usize {
    x % 2 + y % 2
}

/// Red, green and blue of a mosaic whose sample (0, 0) is pixel `origin` of the sensor. The mosaic is
/// mirrored at its border, which keeps the filters' order.
pub(super) fn demosaiced(
    mosaic: &Plane<f32>,
    origin: [usize; 2],
    method: Demosaic,
) -> [Plane<f32>; 3] {
    let (width, height) = (mosaic.width(), mosaic.height());
    let mut planes = [0, 1, 2].map(|_| mosaic.clone());
    for y in 0..height {
        for x in 0..width {
            let inside = x >= 2 && y >= 2 && x + 2 < width && y + 2 < height;
            let at = |dx: isize, dy: isize| {
                if inside {
                    mosaic.at(x.wrapping_add_signed(dx), y.wrapping_add_signed(dy))
                } else {
                    mosaic.at(mirrored(x, dx, width), mirrored(y, dy, height))
                }
            };
            let here = filter(x + origin[0], y + origin[1]);
            let is_malvar = method == Demosaic::Malvar;
            let beside = at(-1, 0) + at(1, 0);
            let above = at(0, -1) + at(0, 1);
            if here == 1 {
                // Of green the colour of its own row lies beside it, the other one above and below.
                let diagonal = at(-1, -1) + at(1, -1) + at(-1, 1) + at(1, 1);
                let (far_beside, far_above) = if is_malvar {
                    (at(-2, 0) + at(2, 0), at(0, -2) + at(0, 2))
                } else {
                    (0.0, 0.0)
                };
                let made = |near: f32, along: f32, across: f32| {
                    if is_malvar {
                        (5.0 * at(0, 0) + 4.0 * near - along - diagonal + 0.5 * across) / 8.0
                    } else {
                        0.5 * near
                    }
                };
                let in_row = if (y + origin[1]).is_multiple_of(2) { 0 } else { 2 };
                planes[in_row].row_mut(y)[x] = made(beside, far_beside, far_above);
                planes[2 - in_row].row_mut(y)[x] = made(above, far_above, far_beside);
            } else {
                let diagonal = at(-1, -1) + at(1, -1) + at(-1, 1) + at(1, 1);
                let (green, other) = if is_malvar {
                    let far = at(-2, 0) + at(2, 0) + at(0, -2) + at(0, 2);
                    (
                        (4.0 * at(0, 0) + 2.0 * (beside + above) - far) / 8.0,
                        (6.0 * at(0, 0) + 2.0 * diagonal - 1.5 * far) / 8.0,
                    )
                } else {
                    (0.25 * (beside + above), 0.25 * diagonal)
                };
                planes[1].row_mut(y)[x] = green;
                planes[2 - here].row_mut(y)[x] = other;
            }
        }
    }
    planes
}

/// The index at a distance, mirrored about the first and the last one.
fn mirrored(index: usize, distance: isize, count: usize) -> usize {
    let last = count.cast_signed() - 1;
    let index = (index.cast_signed() + distance).abs();
    (last - (last - index).abs()).max(0).unsigned_abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mosaic of three planes.
    fn mosaic(planes: &[Plane<f32>; 3]) -> Plane<f32> {
        Plane::from_fn(planes[0].width(), planes[0].height(), |x, y| planes[filter(x, y)].at(x, y))
    }

    #[test]
    fn ramps_of_one_grey_come_back_inside() {
        let grey = Plane::from_fn(12, 10, |x, y| 3.0 * x as f32 - 2.0 * y as f32 + 50.0);
        let planes = [grey.clone(), grey.clone(), grey];
        for method in [Demosaic::Bilinear, Demosaic::Malvar] {
            let found = demosaiced(&mosaic(&planes), [0, 0], method);
            for (plane, wanted) in found.iter().zip(&planes) {
                for y in 2..8 {
                    for x in 2..10 {
                        assert!((plane.at(x, y) - wanted.at(x, y)).abs() < 1e-4, "{method:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn flat_colours_come_back_to_the_border() {
        let planes = [10.0, 90.0, 40.0].map(|value| Plane::filled(7, 6, value));
        for method in [Demosaic::Bilinear, Demosaic::Malvar] {
            let found = demosaiced(&mosaic(&planes), [0, 0], method);
            for (plane, wanted) in found.iter().zip(&planes) {
                let far = plane.samples().iter().zip(wanted.samples()).map(|(a, b)| (a - b).abs());
                // Colour differs: the correction by another colour's gradient is zero where flat.
                assert!(far.fold(0.0, f32::max) < 1e-4, "{method:?}: {plane:?}");
            }
        }
    }

    #[test]
    fn a_region_is_demosaiced_as_in_the_whole() {
        let whole = Plane::from_fn(16, 14, |x, y| ((7 * x + 13 * y * y + x * y) % 31) as f32);
        let all = demosaiced(&whole, [0, 0], Demosaic::Malvar);
        let window = crate::image::PixelRange { x0: 3, y0: 2, x1: 14, y1: 13 };
        let part = demosaiced(&whole.crop(window), [3, 2], Demosaic::Malvar);
        for (all, part) in all.iter().zip(&part) {
            for y in 2..9 {
                for x in 2..9 {
                    assert_eq!(part.at(x, y).to_bits(), all.at(x + 3, y + 2).to_bits());
                }
            }
        }
    }
}
