//! The whole face with the fewest gaps.
//!
//! ```text
//! # Method      A *side* joins two corners along one straight edge of the image. The step across it
//!               (over 2 px, of red or green, the larger, smoothed by [1 2 1] / 4 in x and y) is
//!               sought within 3 px; support = the largest share of samples whose step lies
//!               within 1 px of one straight line.
//!               *Of the target's colour* is what has purity 1 - max(G, B) / R >= 0.6 of the
//!               mask's mean and R >= 0.15 of its mean: a face in shade too, which the mask lacks.
//!               An *outline* is a convex quadrilateral of four sides that could be one face:
//!                 parallel       opposite sides nearly are;
//!                 one brightness no step, beyond the median slope, between medians of red along
//!                                lines parallel to a side;
//!                 no T-junction  no side runs on beyond its corner with three times an edge's
//!                                step and the target on neither side: an occluder's outline;
//!                 convex target  none of the colour lies beyond a side that has none next to it.
//!               Outlines inside a larger outline are parts of a face and are dropped. The answer
//!               has, among those with gap <= max_gap, the largest
//!                 area * support of the weakest side * (1 - gap / max_gap);
//!               gap = share of the pixels at least 1.5 px inside that lack the target's colour.
//! # Input       encoded exposure; the target's mask; refined corners in any order. Steps are
//!               relative to the mask's mean red: gain does not matter.
//! # Parameters  max_gap_fraction     none, 0.12  range [0.001, 1]: hidden share of the face; the
//!                                                tip of a leaf does not exclude it
//!               min_area_fraction    none, 0.1   range [0, 1]: of the target-coloured pixels
//!               min_side_support     none, 0.75  range [0.1, 1]: of the weakest side
//!               edge_step_fraction   none, 0.04  range [0.005, 0.5]: an edge from here on, one
//!                                                face up to here
//!               max_convergence_deg  deg, 20     range [0, 60]: between opposite sides, beyond
//!                                                what corner errors of 3 px explain
//!               max_corners          none, 64    range [4, 64]: the strongest within 3 px of the
//!                                                target's colour; inner corners are weak
//! # Output      the corners as given, clockwise as seen from the topmost (then leftmost);
//!               too_few_corners below four near the target, all_occluded when no outline passes.
//! # Border      corners outside the image are ignored; the border pixels continue outwards.
//! # Cost        O(corners^2) sides of at most 20 samples, O(pixels) for each outline. On rendered
//!               targets of about 100 px with up to 104 corners: mean 6 ms, at most 16 ms;
//!               drawn ones of 40 to 200 px: 3 ms, at most 8 ms.
//! # Departures  The source asks for "small or no gaps in the corner point range" and gives no
//!               formula: every test and threshold above is ours.
//!               All four corners of the face are needed; none is completed. A hard shadow across
//!               a face makes it two; two faces less than a step apart are one. An occluder that
//!               hides the end of a face along a straight line passes for the face's edge when
//!               its outline shows nowhere beside the target.
//!               230 drawn cuboids, corners 0 to 2.5 px off, a face is hit at IoU > 0.8. Where a
//!               face was whole and its corners found, in % (n):
//!                 target hidden       right  other face  no face  declined
//!                 not at all (45)     100.0         0.0      0.0       0.0
//!                 < 10 % (26)          84.6         3.8      0.0      11.5
//!                 10 to 30 % (27)      55.6         3.7      7.4      33.3
//!                 30 to 60 % (8)       87.5         0.0      0.0      12.5
//!               Where every face was hidden by more than 8 % (95): declined 89, no face 6, a face
//!               hidden a little more than that 4.
//!               26 rendered scenes, targets of about 100 px, the plan `paper`. Where a face was
//!               seen by 95 % or more and its corners were found within 3 px (12 scenes), the least
//!               occluded face was chosen in 11, none in 1 (two faces of like brightness). In the
//!               other 14 none was chosen in 13, the right face in 1. The same scenes served to
//!               find the faults of an earlier version; thresholds were set on 16 of them.
//! # Source      Visual recognition of robot targets in complex state based on sub-pixel Harris
//!               corner, section 5.
//! # Checked by  tests below; tests/it/grasp.rs (prints the rates on drawn cuboids)
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::ImagePoint;
use crate::grasp::evidence::{Line, SEARCH_PX, Side, Target, sides_of};
use crate::grasp::{Face, FaceSelector, NoFace};
use crate::refine::Corner;
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::{Exposure, RangeImage, Rig};
use crate::target::TargetRegion;

/// The registry's line.
pub const ENTRY: Entry<dyn FaceSelector> = Entry {
    name: "least_occluded",
    summary: "the whole face with the fewest gaps: four corners, straight edges, one brightness",
    reference: "Visual recognition of robot targets in complex state based on sub-pixel Harris \
                corner, section 5",
    version: 1,
    defaults: defaults::<LeastOccluded>,
    schema: schema::<LeastOccluded>,
    build: |place, table| Ok(Box::new(parameters::<LeastOccluded>(place, table)?)),
};

/// Of corners nearer to each other than this one is enough \[px\].
const MERGE_PX: f64 = 1.5;
/// Outlines hidden by more than this share are accidents.
const MAX_HIDDEN_FRACTION: f64 = 0.8;
/// How much larger an outline must be for another inside it to be its part.
const PART_AREA_RATIO: f64 = 1.15;

/// The selector; its parameters are those of the header.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct LeastOccluded {
    /// Largest share of the chosen face's pixels that may be hidden.
    #[schemars(range(min = 0.001, max = 1.0))]
    pub max_gap_fraction: f64,
    /// Smallest area of a face, as a share of the pixels of the target's colour.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_area_fraction: f64,
    /// Smallest share of each side that must lie on an edge of the image.
    #[schemars(range(min = 0.1, max = 1.0))]
    pub min_side_support: f64,
    /// The smallest step that is an edge and the largest within one face, as a share of the
    /// target's mean red.
    #[schemars(range(min = 0.005, max = 0.5))]
    pub edge_step_fraction: f64,
    /// Largest angle between opposite sides, beyond what corner errors explain \[deg\].
    #[schemars(range(min = 0.0, max = 60.0))]
    pub max_convergence_deg: f64,
    /// How many of the strongest corners are considered.
    #[schemars(range(min = 4, max = 64))]
    pub max_corners: usize,
}

impl Default for LeastOccluded {
    fn default() -> Self {
        Self {
            max_gap_fraction: 0.12,
            min_area_fraction: 0.1,
            min_side_support: 0.75,
            edge_step_fraction: 0.04,
            max_convergence_deg: 20.0,
            max_corners: 64,
        }
    }
}

impl LeastOccluded {
    /// The strongest corners next to the target, of those closer than [`MERGE_PX`] the strongest.
    fn strongest(&self, target: &Target, corners: &[Corner]) -> Vec<ImagePoint> {
        let mut corners: Vec<&Corner> =
            corners.iter().filter(|corner| target.is_near(corner.position)).collect();
        corners.sort_by(|a, b| b.seed.response.total_cmp(&a.seed.response));
        let mut points: Vec<ImagePoint> = Vec::new();
        for point in corners.into_iter().map(|corner| corner.position) {
            if points.iter().all(|kept| kept.distance_px(point) >= MERGE_PX) {
                points.push(point);
            }
        }
        points.truncate(self.max_corners);
        points
    }

    /// Every quadrilateral of `points` that could be one face.
    fn outlines(&self, target: &Target, points: &[ImagePoint]) -> Vec<Outline> {
        let count = points.len();
        let mut sides: Vec<Option<Side>> = vec![None; count * count];
        for from in 0..count {
            for to in from + 1..count {
                let side = target.side(points[from], points[to], self.min_side_support);
                sides[from * count + to] = side;
                sides[to * count + from] = side.map(Side::reversed);
            }
        }
        let from = |corner: usize, least: usize| {
            let row = &sides[corner * count..(corner + 1) * count];
            (least..count).filter_map(move |to| Some((to, row[to]?)))
        };

        // Closed walks of four sides from their first corner, turning right at each corner.
        let mut outlines = Vec::new();
        for i in 0..count {
            for (j, ij) in from(i, i + 1) {
                for (k, jk) in from(j, i + 1).filter(|(_, jk)| ij.turns_right_to(jk)) {
                    for (l, kl) in from(k, i + 1).filter(|(_, kl)| jk.turns_right_to(kl)) {
                        let Some(li) = sides[l * count + i] else { continue };
                        if kl.turns_right_to(&li) && li.turns_right_to(&ij) {
                            let corners = [i, j, k, l].map(|n| points[n]);
                            outlines.extend(self.outline(target, corners, [ij, jk, kl, li]));
                        }
                    }
                }
            }
        }
        outlines
    }

    /// The outline of four corners and the sides that join them, when it could be one face.
    fn outline(
        &self,
        target: &Target,
        corners: [ImagePoint; 4],
        sides: [Side; 4],
    ) -> Option<Outline> {
        let area_px2 = convex_clockwise_area(&corners)?;
        let is_plausible = area_px2 >= self.min_area_fraction * target.pixels
            && convergence(&corners) <= self.max_convergence_deg.to_radians().sin();
        if !is_plausible {
            return None;
        }
        let gap_fraction = target.gap_fraction(&corners)?;
        let is_face = gap_fraction <= MAX_HIDDEN_FRACTION
            && !sides.iter().any(|side| {
                target.lies_beyond(&side.line)
                    || target.runs_on(&side.line)
                    || target.runs_on(&side.reversed().line)
            })
            && target.largest_step(&corners) <= target.min_step;
        let support = sides.iter().map(|side| side.support).fold(1.0, f64::min);
        is_face.then_some(Outline { corners, area_px2, support, gap_fraction })
    }

    fn score(&self, outline: &Outline) -> f64 {
        let unspent = 1.0 - outline.gap_fraction / self.max_gap_fraction;
        outline.area_px2 * outline.support * unspent
    }
}

impl FaceSelector for LeastOccluded {
    fn select(
        &self,
        exposure: &Exposure,
        region: &TargetRegion,
        corners: &[Corner],
        _rig: &Rig,
        _range: &RangeImage,
    ) -> std::result::Result<Face, NoFace> {
        let target = Target::new(exposure, region, self.edge_step_fraction);
        let points = self.strongest(&target, corners);
        if points.len() < 4 {
            return Err(NoFace::TooFewCorners);
        }
        let outlines = self.outlines(&target, &points);
        outlines
            .iter()
            .filter(|outline| outline.gap_fraction <= self.max_gap_fraction)
            .filter(|outline| !outlines.iter().any(|other| outline.is_part_of(other)))
            .max_by(|a, b| self.score(a).total_cmp(&self.score(b)))
            .map(|best| {
                Face::of_corners(from_the_topmost(best.corners), best.gap_fraction, corners)
            })
            .ok_or(NoFace::AllOccluded)
    }
}

/// A quadrilateral that could be one face.
struct Outline {
    corners: [ImagePoint; 4],
    area_px2: f64,
    /// Of the weakest side.
    support: f64,
    gap_fraction: f64,
}

impl Outline {
    /// Whether it lies inside a larger outline, corner errors allowed for.
    fn is_part_of(&self, other: &Self) -> bool {
        other.area_px2 > PART_AREA_RATIO * self.area_px2
            && sides_of(&other.corners)
                .iter()
                .all(|side| self.corners.iter().all(|&p| side.coordinates(p).1 > -SEARCH_PX))
    }
}

/// Twice the signed area of a triangle, positive when a, b, c run clockwise as seen.
fn turn(a: ImagePoint, b: ImagePoint, c: ImagePoint) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

/// The area of a quadrilateral \[px^2\]; `None` unless it is strictly convex and clockwise as seen.
fn convex_clockwise_area(&[a, b, c, d]: &[ImagePoint; 4]) -> Option<f64> {
    let turns = [turn(a, b, c), turn(b, c, d), turn(c, d, a), turn(d, a, b)];
    turns.iter().all(|&turn| turn > 0.0).then(|| 0.5 * (turns[0] + turns[2]))
}

/// Sine of the larger angle between opposite sides, less what corner errors explain.
fn convergence(corners: &[ImagePoint; 4]) -> f64 {
    let between = |a: &Line, b: &Line| {
        let sine = a.direction[0] * b.direction[1] - a.direction[1] * b.direction[0];
        sine.abs() - SEARCH_PX / a.length_px.min(b.length_px)
    };
    let [ab, bc, cd, da] = sides_of(corners);
    between(&ab, &cd).max(between(&bc, &da))
}

/// The same corners in the same sense, the topmost first, the leftmost of equals.
fn from_the_topmost(mut corners: [ImagePoint; 4]) -> [ImagePoint; 4] {
    let first = (0..4).min_by(|&m, &n| {
        let (a, b) = (corners[m], corners[n]);
        a.y.total_cmp(&b.y).then(a.x.total_cmp(&b.x))
    });
    corners.rotate_left(first.unwrap_or(0));
    corners
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::Detection;
    use crate::geometry::{Camera, Pose};
    use crate::image::{PixelRange, Plane};
    use crate::refine::RefineStatus;
    use crate::sensor::{Encoding, Transfer};

    /// Grey, 64 x 64, with a rectangle of `red` over the pixels from (12, 16) to (43, 51).
    fn rectangle(red: f32) -> (Exposure, TargetRegion) {
        let range = PixelRange { x0: 12, y0: 16, x1: 44, y1: 52 };
        let mask = Plane::from_fn(64, 64, |x, y| (12..44).contains(&x) && (16..52).contains(&y));
        let rgb =
            [red, 20.0, 20.0].map(|dn| mask.map(|of_target| if of_target { dn } else { 120.0 }));
        let exposure =
            Exposure::new(rgb, Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 })
                .expect("finite");
        let quadrilateral =
            [[12.0, 16.0], [43.0, 16.0], [43.0, 51.0], [12.0, 51.0]].map(ImagePoint::from);
        (exposure, TargetRegion { mask, range, quadrilateral, pixels: 32 * 36 })
    }

    fn corners(points: &[[f64; 2]]) -> Vec<Corner> {
        let corner = |&point: &[f64; 2]| Corner {
            seed: Detection::new(point.into(), 1.0),
            position: point.into(),
            covariance_px2: None,
            iterations: 0,
            status: RefineStatus::Ok,
        };
        points.iter().map(corner).collect()
    }

    fn rig() -> Rig {
        let camera = Camera::pinhole(64, 64, 64.0);
        Rig { camera, world_from_camera: Pose::identity(), object_size_m: None }
    }

    #[test]
    fn a_rectangle_is_returned_clockwise_from_its_topmost_corner() {
        let (exposure, region) = rectangle(200.0);
        let found =
            corners(&[[43.0, 51.0], [12.0, 51.5], [30.0, 30.0], [43.5, 16.0], [13.0, 15.5]]);
        let face = LeastOccluded::default()
            .select(&exposure, &region, &found, &rig(), &RangeImage::blind())
            .expect("whole");
        let expected = [[13.0, 15.5], [43.5, 16.0], [43.0, 51.0], [12.0, 51.5]];
        assert_eq!(face.corners, expected.map(ImagePoint::from));
        assert!(face.gap_fraction.abs() < 1e-12);
    }

    #[test]
    fn a_hole_is_counted_as_gap() {
        let (whole, mut region) = rectangle(200.0);
        let rgb = whole.rgb().clone().map(|mut plane| {
            (30..40).for_each(|y| plane.row_mut(y)[20..30].fill(120.0));
            plane
        });
        (30..40).for_each(|y| region.mask.row_mut(y)[20..30].fill(false));
        let exposure = Exposure::new(rgb, whole.encoding()).expect("finite");
        let found = corners(&[[12.0, 16.0], [43.0, 16.0], [43.0, 51.0], [12.0, 51.0]]);
        let select = |max_gap_fraction| {
            let selector = LeastOccluded { max_gap_fraction, ..LeastOccluded::default() };
            selector.select(&exposure, &region, &found, &rig(), &RangeImage::blind())
        };
        // Pixels at least 1.5 px inside 31 x 35 px: 28 x 32.
        let face = select(0.2).expect("a gap of 11 %");
        assert!((face.gap_fraction - 100.0 / 896.0).abs() < 1e-12);
        assert_eq!(select(0.11), Err(NoFace::AllOccluded));
    }

    #[test]
    fn a_corner_that_is_missing_is_not_made_up() {
        let (exposure, region) = rectangle(200.0);
        let three = corners(&[[12.0, 16.0], [43.0, 16.0], [43.0, 51.0]]);
        let selector = LeastOccluded::default();
        assert_eq!(
            selector.select(&exposure, &region, &three, &rig(), &RangeImage::blind()),
            Err(NoFace::TooFewCorners)
        );
        let other = corners(&[[12.0, 16.0], [43.0, 16.0], [43.0, 51.0], [28.0, 40.0]]);
        assert_eq!(
            selector.select(&exposure, &region, &other, &rig(), &RangeImage::blind()),
            Err(NoFace::AllOccluded)
        );
    }

    #[test]
    fn only_the_clockwise_convex_order_has_an_area() {
        let square = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]].map(ImagePoint::from);
        let [a, b, c, d] = square;
        assert_eq!(convex_clockwise_area(&square), Some(12.0));
        assert_eq!(convex_clockwise_area(&[d, c, b, a]), None);
        assert_eq!(convex_clockwise_area(&[a, c, b, d]), None);
        assert_eq!(convex_clockwise_area(&[a, b, b, c]), None);
    }

    #[test]
    fn a_parameter_out_of_range_is_named() {
        let table = "max_gap_fraction = 0.0".parse().expect("valid TOML");
        let error = (ENTRY.build)("plan.toml", &table).err().expect("out of range");
        let expected = "plan.toml: max_gap_fraction is 0, must be in [0.001, 1]";
        assert_eq!(error.to_string(), expected);
    }
}
