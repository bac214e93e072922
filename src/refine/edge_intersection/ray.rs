//! A ray in the image: where its edge is seen, column by column.
//!
//! Stations are the columns of pixels that the ray crosses, or the rows where it is steep: each pixel belongs to
//! one station, so that the errors of stations are independent, and nothing is interpolated.

use nalgebra::{Matrix2, Vector2};

use super::Operator;
use super::{devernay, erf_profile, partial_area};
use crate::refine::edges::Line;
use crate::refine::light::Light;

/// Pixels of a column at most.
pub(super) const MOST: usize = 64;

/// How near to another ray pixels are that it changes, in blurs.
const MARGIN: f64 = 3.0;

/// So many places along a ray are looked at for the step across it \[px\].
const STATIONS: u32 = 10;

/// What an operator found at a station.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    /// How far across the line the edge is \[px\].
    pub offset_px: f64,
    /// By the noise of the pixels \[px^2\].
    pub variance_px2: f64,
    /// The step across the edge; about 1.
    pub step: f64,
    pub step_variance: f64,
    /// The blur, where the station alone tells it \[px\].
    pub blur_px: Option<f64>,
    pub shape: Shape,
}

/// What a station tells of the edge's shape, which is that of the whole ray: by how much more than in a ramp light
/// changes away from the edge on both sides \[1/px\], and how much wider than thought the blur is, in
/// blurs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shape {
    /// Inverse covariance.
    pub information: Matrix2<f64>,
    /// It times the shape.
    pub score: Vector2<f64>,
    /// By how much the shape moves the offset \[px\].
    pub moves_px: Vector2<f64>,
}

/// An edge at a station.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edgel {
    /// How far out \[px\].
    pub along_px: f64,
    pub offset_px: f64,
    pub variance_px2: f64,
    /// The step across the edge and its variance.
    step: f64,
    step_variance: f64,
    /// By how much the ray's shape moves it \[px\].
    pub moves_px: Vector2<f64>,
}

/// What a ray's edge looks like, as far as is known.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    /// Its blur, the pixel's area included \[px\].
    pub sigma_px: f64,
    /// By how much its step grows outwards, of the step near the corner \[1/px\].
    pub growth_per_px: f64,
}

/// A ray and the light about it, projected from all channels to one number that steps by 1 across it.
pub(super) struct Ray<'a> {
    light: &'a Light<'a>,
    pub line: Line,
    direction: Vector2<f64>,
    normal: Vector2<f64>,
    pub look: Look,
    /// Sine and cosine to the next ray, to smaller and larger angles; where it is at a right angle or more, what is
    /// beyond the corner is away from it.
    sectors: [Option<(f64, f64)>; 2],
    /// Of each channel; none steps where they are all 0.
    weights: [f64; 3],
    /// Variance of the number on both sides, to smaller and larger angles.
    pub variances: [f64; 2],
    /// The coordinate that counts stations: x where the ray is flat, y where it is steep.
    along: usize,
}

/// The pixels of a station.
pub(super) struct Column {
    /// Of the station \[px\].
    pub place: isize,
    /// Where the line crosses it \[px\].
    pub crossing_px: f64,
    /// The first pixel, across \[px\].
    pub first: isize,
    pub count: usize,
    pub values: [f64; MOST],
    /// From the line, positive to larger angles \[px\].
    pub distances_px: [f64; MOST],
    /// Whether they are in the image and away from other rays.
    pub usable: [bool; MOST],
}

impl Default for Column {
    fn default() -> Self {
        Self {
            place: 0,
            crossing_px: 0.0,
            first: 0,
            count: 0,
            values: [0.0; MOST],
            distances_px: [0.0; MOST],
            usable: [false; MOST],
        }
    }
}

/// How a ray was followed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Followed {
    /// What stations tell of the edge.
    pub look: Look,
    /// What the mean over many stations has of their variance: 1 where their errors are independent.
    pub kept: f64,
    /// Covariance of the shape.
    pub shape: Matrix2<f64>,
    /// Whether it ended where the image does.
    pub left_image: bool,
}

impl<'a> Ray<'a> {
    /// That of one of the lines, in order of their angles, that leave a vertex.
    pub fn new(light: &'a Light<'a>, lines: &[Line], index: usize, look: Look) -> Self {
        let line = lines[index];
        let opening = |from: &Line, to: &Line| {
            let opening = (to.angle_rad - from.angle_rad).rem_euclid(std::f64::consts::TAU);
            (opening < std::f64::consts::FRAC_PI_2).then(|| opening.sin_cos())
        };
        let count = lines.len();
        let [before, after] = [lines[(index + count - 1) % count], lines[(index + 1) % count]];
        let direction = line.direction();
        let mut ray = Self {
            light,
            line,
            direction,
            normal: line.normal(),
            look,
            sectors: [opening(&before, &line), opening(&line, &after)],
            weights: [0.0; 3],
            variances: [1.0; 2],
            along: usize::from(direction.y.abs() > direction.x.abs()),
        };
        ray.project();
        ray
    }

    /// Whether a place so far along and across lies beside this ray and away from all others.
    fn is_clear(&self, along_px: f64, across_px: f64) -> bool {
        let margin_px = MARGIN * self.look.sigma_px;
        let far_px = self.sectors[usize::from(across_px > 0.0)]
            .map_or(f64::MAX, |(sine, cosine)| along_px * sine - across_px.abs() * cosine);
        along_px >= margin_px && far_px >= margin_px
    }

    /// A pixel of the image, by its places along and across; `None` where it is not to be used.
    fn pixel(&self, place: isize, across: isize) -> Option<[isize; 2]> {
        let [x, y] = if self.along == 0 { [place, across] } else { [across, place] };
        let exposure = self.light.exposure;
        let (width, height) = (exposure.width().cast_signed(), exposure.height().cast_signed());
        let is_inside = (0..width).contains(&x) && (0..height).contains(&y);
        (is_inside && !exposure.saturated().at(x.cast_unsigned(), y.cast_unsigned()))
            .then_some([x, y])
    }

    /// The projected light of a pixel beside the ray; `None` where it is not to be used.
    pub fn value(&self, place: isize, across: isize) -> Option<f64> {
        let [x, y] = self.pixel(place, across)?;
        let from = Vector2::new(x as f64, y as f64) - self.line.origin;
        self.is_clear(from.dot(&self.direction), from.dot(&self.normal)).then(|| {
            let of = |(plane, weight): (&crate::image::Plane<f32>, f64)| {
                weight * f64::from(self.light.of(plane.at(x.cast_unsigned(), y.cast_unsigned())))
            };
            self.light.planes.iter().zip(self.weights).map(of).sum()
        })
    }

    /// How much farther across the line the next pixel of a column is \[px\], with its sign.
    pub fn across_px(&self) -> f64 {
        self.normal[1 - self.along]
    }

    /// By how many pixels of a column the line moves from one station to the next.
    pub fn slope(&self) -> f64 {
        self.direction[1 - self.along] / self.direction[self.along]
    }

    /// The step that is expected so far along: 1 as a mean of where it was measured.
    fn step(&self, along_px: f64) -> f64 {
        let middle_px = MARGIN * self.look.sigma_px + 0.5 * f64::from(STATIONS);
        1.0 + self.look.growth_per_px * (along_px - middle_px)
    }

    /// The weights of channels by which the step is 1 and largest over the noise: steps over variances.
    fn project(&mut self) {
        let mut sums = [[0.0; 3]; 2];
        let mut counts = [0.0; 2];
        for station in 0..STATIONS {
            let along_px = MARGIN * self.look.sigma_px + 0.5 + f64::from(station);
            for far_px in [2.0 * self.look.sigma_px + 0.5, 2.0 * self.look.sigma_px + 1.5] {
                for (side, across_px) in [-far_px, far_px].into_iter().enumerate() {
                    let point =
                        self.line.origin + along_px * self.direction + across_px * self.normal;
                    #[allow(clippy::cast_possible_truncation, reason = "saturates: not inside")]
                    let [place, across] =
                        [self.along, 1 - self.along].map(|axis| point[axis].round() as isize);
                    let Some([x, y]) = self.pixel(place, across) else { continue };
                    if !self.is_clear(along_px, across_px) {
                        continue;
                    }
                    counts[side] += 1.0;
                    for (sum, plane) in sums[side].iter_mut().zip(self.light.planes) {
                        let sample = plane.at(x.cast_unsigned(), y.cast_unsigned());
                        *sum += f64::from(self.light.of(sample));
                    }
                }
            }
        }
        if counts[0] < 3.0 || counts[1] < 3.0 {
            return;
        }
        let channels = self.light.planes.len();
        let mut of_channel = [[0.0; 2]; 3];
        let mut total = 0.0;
        for channel in 0..channels {
            let levels = [0, 1].map(|side: usize| sums[side][channel] / counts[side]);
            #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
            let variances =
                levels.map(|level| f64::from(self.light.variance(channel, level as f32)));
            let step = levels[1] - levels[0];
            self.weights[channel] = 2.0 * step / (variances[0] + variances[1]);
            total += self.weights[channel] * step;
            of_channel[channel] = variances;
        }
        if total <= 0.0 {
            return;
        }
        self.weights = self.weights.map(|weight| weight / total);
        self.variances = [0, 1].map(|side: usize| {
            (0..channels).map(|c| self.weights[c].powi(2) * of_channel[c][side]).sum()
        });
    }

    /// Takes the pixels of a station so far across the line and nearer.
    fn take(&self, place: isize, half_px: f64, column: &mut Column) {
        let across_px = self.across_px();
        let (origin, line) = (self.line.origin[self.along], self.line.origin[1 - self.along]);
        column.place = place;
        column.crossing_px = line + (place as f64 - origin) * self.slope();
        let reach = (half_px / across_px.abs()).min(0.5 * (MOST - 1) as f64);
        #[allow(clippy::cast_possible_truncation, reason = "near the image")]
        let [first, last] = [
            (column.crossing_px - reach).ceil() as isize,
            (column.crossing_px + reach).floor() as isize,
        ];
        column.first = first;
        column.count = (last - first + 1).clamp(0, MOST.cast_signed()).cast_unsigned();
        for (index, across) in (first..=last).take(MOST).enumerate() {
            let value = self.value(place, across);
            column.distances_px[index] = across_px * (across as f64 - column.crossing_px);
            column.usable[index] = value.is_some();
            column.values[index] = value.unwrap_or(0.0);
        }
    }

    /// Follows the edge outwards, so far at most, while it is seen and stays in line.
    pub fn follow(
        &self,
        operator: Operator,
        flank_px: f64,
        limit_px: f64,
        column: &mut Column,
        edgels: &mut Vec<Edgel>,
    ) -> Followed {
        const GAP_PX: f64 = 3.0;
        const LATEST_PX: f64 = 12.0;
        const SEEN: f64 = 4.0;
        const OFF_PX: f64 = 0.3;
        const MOST_CHANGE: f64 = 2.5;
        const LEAST_STEP: f64 = 0.25;
        edgels.clear();
        let mut followed =
            Followed { look: self.look, kept: 1.0, shape: Matrix2::zeros(), left_image: false };
        if operator == Operator::PartialArea {
            followed.kept = partial_area::kept(self);
        }
        if self.weights.iter().all(|weight| *weight == 0.0) {
            return followed;
        }
        let pace = self.direction[self.along];
        let origin = self.line.origin[self.along];
        let least_px = MARGIN * self.look.sigma_px;
        let half_px = match operator {
            Operator::Devernay => devernay::REACH_PX,
            Operator::Erf => MARGIN * self.look.sigma_px + flank_px,
            Operator::PartialArea => partial_area::reach_px(self),
        };
        let mut last_px = least_px + LATEST_PX;
        let mut blurs_px = [0.0; 2];
        let (mut information, mut score) = (Matrix2::zeros(), Vector2::zeros());
        let first = origin + pace * least_px;
        #[allow(clippy::cast_possible_truncation, reason = "near the image")]
        let mut place = if pace > 0.0 { first.ceil() } else { first.floor() } as isize;
        loop {
            let along_px = (place as f64 - origin) / pace;
            if along_px > limit_px || along_px > last_px + GAP_PX {
                break;
            }
            self.take(place, half_px, column);
            #[allow(clippy::cast_possible_truncation, reason = "near the image")]
            if self.pixel(place, column.crossing_px.round() as isize).is_none() {
                followed.left_image = true;
                break;
            }
            place += if pace > 0.0 { 1 } else { -1 };
            let usual = self.step(along_px);
            if usual < LEAST_STEP {
                break;
            }
            let off_px2 = self.line.variance_px2(along_px);
            let found = match operator {
                Operator::Devernay => devernay::locate(self, column, off_px2.sqrt()),
                Operator::Erf => erf_profile::locate(self, column, usual),
                Operator::PartialArea => partial_area::locate(self, column),
            };
            let Some(found) = found else { continue };
            let most_px = 3.0 * (off_px2 + found.variance_px2).sqrt() + OFF_PX;
            let is_seen = found.step > SEEN * found.step_variance.sqrt()
                && (1.0 / MOST_CHANGE..MOST_CHANGE).contains(&(found.step / usual));
            if !is_seen || found.offset_px.abs() > most_px {
                continue;
            }
            last_px = along_px;
            if let Some(blur_px) = found.blur_px {
                blurs_px = [blurs_px[0] + blur_px, blurs_px[1] + 1.0];
            }
            information += found.shape.information;
            score += found.shape.score;
            edgels.push(Edgel {
                along_px,
                offset_px: found.offset_px,
                variance_px2: found.variance_px2,
                step: found.step,
                step_variance: found.step_variance,
                moves_px: found.shape.moves_px,
            });
        }
        self.straighten(&mut followed, edgels);
        let mut wider = 1.0;
        if blurs_px[1] > 0.0 {
            wider = blurs_px[0] / blurs_px[1] / self.look.sigma_px;
        }
        if let Some(covariance) = information.try_inverse() {
            let shape = covariance * score;
            wider += shape.y;
            followed.shape = covariance;
            for edgel in edgels {
                edgel.offset_px += edgel.moves_px.dot(&shape);
            }
        }
        followed.look.sigma_px = (wider.clamp(0.6, 1.6) * self.look.sigma_px).clamp(0.3, 4.0);
        followed
    }

    /// Along a slanted column the step grows, too: with the ramps across it is taken for a blurred one, where that
    /// along the edge is none, and t sigma^2 A' / A too far, t what a column leads along the edge for each px
    /// across.
    fn straighten(&self, followed: &mut Followed, edgels: &mut [Edgel]) {
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for edgel in edgels.iter() {
            let place = Vector2::new(1.0, edgel.along_px);
            normal += place * place.transpose() / edgel.step_variance;
            right += edgel.step * place / edgel.step_variance;
        }
        let Some(inverse) = normal.try_inverse() else { return };
        let steps = inverse * right;
        let slant = self.direction[1 - self.along] / self.normal[1 - self.along];
        let sigma_px2 = self.look.sigma_px.powi(2);
        for edgel in edgels {
            edgel.offset_px -= slant * sigma_px2 * steps.y / (steps.x + steps.y * edgel.along_px);
        }
        let middle = steps.x + steps.y * (MARGIN * self.look.sigma_px + 0.5 * f64::from(STATIONS));
        followed.look.growth_per_px = steps.y / middle;
    }
}
