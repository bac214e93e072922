//! From an exposure to the region that holds the target.

use geo::{LineString, MinimumRotatedRect, MultiPoint};

use crate::geometry::ImagePoint;
use crate::image::{PixelRange, Plane};
use crate::registry::Entry;
use crate::sensor::Exposure;

pub mod red_difference;
pub mod red_share;

/// The part of an image that holds the target.
#[derive(Clone, Debug)]
pub struct TargetRegion {
    /// True on the target's pixels; the size of the exposure.
    pub mask: Plane<bool>,
    /// The smallest range of rows and columns that holds the mask.
    pub range: PixelRange,
    /// The smallest circumscribed quadrilateral, rotated: corners in clockwise order as seen.
    pub quadrilateral: [ImagePoint; 4],
    /// Pixels in the mask.
    pub pixels: usize,
}

impl TargetRegion {
    /// The region of a mask; `None` when no pixel is in it.
    ///
    /// The quadrilateral is the rectangle of least area, at any angle, that holds the pixels whole
    /// (half a pixel around each centre); its first corner is the topmost, of two the left one.
    pub fn from_mask(mask: Plane<bool>) -> Option<Self> {
        let mut range = PixelRange { x0: mask.width(), y0: mask.height(), x1: 0, y1: 0 };
        let (mut outline, mut pixels) = (Vec::new(), 0);
        for y in 0..mask.height() {
            let row = mask.row(y);
            let (Some(first), Some(last)) =
                (row.iter().position(|&inside| inside), row.iter().rposition(|&inside| inside))
            else {
                continue;
            };
            range.x0 = range.x0.min(first);
            range.x1 = range.x1.max(last + 1);
            range.y0 = range.y0.min(y);
            range.y1 = y + 1;
            pixels += row[first..=last].iter().filter(|&&inside| inside).count();
            let (left, right, y) = (first as f64 - 0.5, last as f64 + 0.5, y as f64);
            outline.extend([left, right].into_iter().flat_map(|x| [(x, y - 0.5), (x, y + 0.5)]));
        }
        let rectangle = MultiPoint::from(outline).minimum_rotated_rect()?;
        let quadrilateral = clockwise_from_the_top(rectangle.exterior())?;
        Some(Self { mask, range, quadrilateral, pixels })
    }

    /// The quadrilateral with each side moved outwards by `margin_px`.
    pub fn grown_quadrilateral(&self, margin_px: f64) -> [ImagePoint; 4] {
        let corners = &self.quadrilateral;
        std::array::from_fn(|i| {
            let corner = corners[i];
            let (mut x, mut y) = (corner.x, corner.y);
            for neighbour in [corners[(i + 1) % 4], corners[(i + 3) % 4]] {
                let length = corner.distance_px(neighbour);
                if length > 0.0 {
                    x += margin_px * (corner.x - neighbour.x) / length;
                    y += margin_px * (corner.y - neighbour.y) / length;
                }
            }
            ImagePoint::new(x, y)
        })
    }
}

/// The corners of a closed rectangle that runs anticlockwise as seen (y down), turned round.
fn clockwise_from_the_top(ring: &LineString<f64>) -> Option<[ImagePoint; 4]> {
    let mut corners: [ImagePoint; 4] = ring
        .coords()
        .take(4)
        .map(|corner| ImagePoint::new(corner.x, corner.y))
        .collect::<Vec<_>>()
        .try_into()
        .ok()?;
    corners.reverse();
    let top = (0..4).min_by(|&i, &j| {
        let key = |k: usize| (corners[k].y, corners[k].x);
        key(i).partial_cmp(&key(j)).unwrap_or(std::cmp::Ordering::Equal)
    })?;
    corners.rotate_left(top);
    Some(corners)
}

/// Why no target was found; counted, never dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoTarget {
    /// No pixel has the target's colour.
    NoPixel,
    /// The largest region of the target's colour is too small to be one.
    TooSmall,
}

impl NoTarget {
    /// The name used in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoPixel => "no_pixel",
            Self::TooSmall => "too_small",
        }
    }
}

/// Finds the target's region in one exposure.
pub trait TargetExtractor: Send + Sync {
    /// Returns the region, or why there is none.
    ///
    /// # Errors
    /// [`NoTarget`], a counted status.
    fn extract(&self, exposure: &Exposure) -> Result<TargetRegion, NoTarget>;
}

/// Every extractor that a plan can name, in alphabetical order.
pub const EXTRACTORS: &[Entry<dyn TargetExtractor>] = &[red_difference::ENTRY, red_share::ENTRY];

/// The largest 8-connected region of a mask, of equals the one met first row by row; `None` when
/// the mask is empty.
pub(crate) fn largest_region(mask: &Plane<bool>) -> Option<Plane<bool>> {
    let (runs, regions) = connected_runs(mask);
    let mut pixels = vec![0; runs.len()];
    for (run, &region) in runs.iter().zip(&regions) {
        pixels[region] += run.end - run.start;
    }
    let largest = (0..runs.len()).rev().max_by_key(|&region| pixels[region])?;
    let mut kept = Plane::filled(mask.width(), mask.height(), false);
    for (run, _) in runs.iter().zip(&regions).filter(|&(_, &region)| region == largest) {
        kept.row_mut(run.y)[run.start..run.end].fill(true);
    }
    Some(kept)
}

/// Neighbouring pixels of one row, all in the mask: columns `start..end`.
struct Run {
    y: usize,
    start: usize,
    end: usize,
}

/// The runs of a mask, row by row, and for each the index of the first run of its 8-connected
/// region (two passes and a union-find over runs).
fn connected_runs(mask: &Plane<bool>) -> (Vec<Run>, Vec<usize>) {
    fn root(parent: &mut [usize], mut run: usize) -> usize {
        while parent[run] != run {
            parent[run] = parent[parent[run]];
            run = parent[run];
        }
        run
    }
    let mut runs: Vec<Run> = Vec::new();
    let mut parent: Vec<usize> = Vec::new();
    let mut above = 0..0; // the runs of the row above
    for y in 0..mask.height() {
        let first = runs.len();
        let mut touching = above.start;
        let mut start = 0;
        for pixels in mask.row(y).chunk_by(|a, b| a == b) {
            let end = start + pixels.len();
            if pixels[0] {
                let run = runs.len();
                runs.push(Run { y, start, end });
                parent.push(run);
                while touching < above.end && runs[touching].end < start {
                    touching += 1;
                }
                for other in (touching..above.end).take_while(|&other| runs[other].start <= end) {
                    let (a, b) = (root(&mut parent, run), root(&mut parent, other));
                    parent[a.max(b)] = a.min(b);
                }
            }
            start = end;
        }
        above = first..runs.len();
    }
    let regions = (0..runs.len()).map(|run| root(&mut parent, run)).collect();
    (runs, regions)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mask drawn with '#'.
    fn drawn(rows: &[&str]) -> Plane<bool> {
        Plane::from_fn(rows[0].len(), rows.len(), |x, y| rows[y].as_bytes()[x] == b'#')
    }

    fn points(corners: [[f64; 2]; 4]) -> [ImagePoint; 4] {
        corners.map(ImagePoint::from)
    }

    #[test]
    fn the_quadrilateral_holds_the_pixels_whole() {
        let region = TargetRegion::from_mask(drawn(&["....", ".##.", ".##.", ".##."]));
        let region = region.expect("not empty");
        assert_eq!(region.range, PixelRange { x0: 1, y0: 1, x1: 3, y1: 4 });
        assert_eq!(region.pixels, 6);
        assert_eq!(region.quadrilateral, points([[0.5, 0.5], [2.5, 0.5], [2.5, 3.5], [0.5, 3.5]]));
        assert_eq!(
            region.grown_quadrilateral(1.0),
            points([[-0.5, -0.5], [3.5, -0.5], [3.5, 4.5], [-0.5, 4.5]])
        );
    }

    #[test]
    fn a_diagonal_line_has_a_diagonal_rectangle() {
        let region = TargetRegion::from_mask(drawn(&["#...", ".#..", "..#.", "...#"]));
        // Sides x - y = -1 and 1, x + y = -1 and 7.
        let expected = points([[0.0, -1.0], [4.0, 3.0], [3.0, 4.0], [-1.0, 0.0]]);
        for (found, expected) in region.expect("not empty").quadrilateral.iter().zip(&expected) {
            assert!(found.distance_px(*expected) < 1e-12, "{found:?} {expected:?}");
        }
    }

    #[test]
    fn diagonal_neighbours_are_one_region() {
        let mask = drawn(&["##..#", "..#..", ".....", "#####"]);
        let largest = largest_region(&mask).expect("not empty");
        assert_eq!(largest, drawn(&[".....", ".....", ".....", "#####"]));
        let mask = drawn(&["#.#.#", ".#.#.", ".....", "####."]);
        let largest = largest_region(&mask).expect("not empty");
        assert_eq!(largest, drawn(&["#.#.#", ".#.#.", ".....", "....."]));
    }

    #[test]
    fn branches_that_meet_late_are_one_region() {
        let spiral = drawn(&["#.#.#.#", "#.#.#.#", "#.#.###", "#.#...#", "#.#####", "###...."]);
        assert_eq!(largest_region(&spiral), Some(spiral));
    }

    #[test]
    fn of_equal_regions_the_first_is_kept() {
        let largest = largest_region(&drawn(&["...##", ".....", "##..."])).expect("not empty");
        assert_eq!(largest, drawn(&["...##", ".....", "....."]));
    }

    #[test]
    fn an_empty_mask_has_no_region() {
        assert_eq!(largest_region(&drawn(&["...", "..."])), None);
        assert!(TargetRegion::from_mask(drawn(&["..."])).is_none());
        assert!(TargetRegion::from_mask(Plane::filled(0, 0, true)).is_none());
    }
}
