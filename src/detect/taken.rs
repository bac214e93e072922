//! Where no more corner may be: pixels nearer to a corner than a distance.

/// Pixels that are taken, a bit each, and the disc that a corner takes.
#[derive(Debug, Default)]
pub(super) struct Taken {
    width: usize,
    height: usize,
    /// Words in a row.
    pitch: usize,
    words: Vec<u64>,
    /// How far to both sides the disc reaches 0, 1, ... rows from its middle; none where it is empty.
    half_widths: Vec<usize>,
}

impl Taken {
    /// Replaces it by an image of which nothing is taken. From then on a corner takes the pixels nearer to
    /// it than `distance_px`; none where that is less than 1.
    pub(super) fn reset(&mut self, [width, height]: [usize; 2], distance_px: f64) {
        (self.width, self.height, self.pitch) = (width, height, width.div_ceil(64));
        self.words.clear();
        self.words.resize(self.pitch * height, 0);
        self.half_widths.clear();
        if distance_px < 1.0 {
            return;
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 1000")]
        let reach = distance_px.ceil() as usize;
        let mut half = reach;
        for dy in 0..=reach {
            while half > 0 && (half * half + dy * dy) as f64 >= distance_px * distance_px {
                half -= 1;
            }
            if (half * half + dy * dy) as f64 >= distance_px * distance_px {
                break;
            }
            self.half_widths.push(half);
        }
    }

    pub(super) fn holds(&self, [x, y]: [usize; 2]) -> bool {
        self.words[y * self.pitch + x / 64] >> (x % 64) & 1 == 1
    }

    /// Takes the disc about a corner.
    pub(super) fn take(&mut self, [x, y]: [usize; 2]) {
        for dy in 0..self.half_widths.len() {
            let half = self.half_widths[dy];
            let (first, last) = (x.saturating_sub(half), (x + half).min(self.width - 1));
            if y + dy < self.height {
                self.take_row(y + dy, first, last);
            }
            if dy <= y {
                self.take_row(y - dy, first, last);
            }
        }
    }

    /// Takes a part of a row.
    fn take_row(&mut self, y: usize, first: usize, last: usize) {
        let words = &mut self.words[y * self.pitch..][..self.pitch];
        let (head, tail) = (u64::MAX << (first % 64), u64::MAX >> (63 - last % 64));
        let (first, last) = (first / 64, last / 64);
        if first == last {
            words[first] |= head & tail;
        } else {
            words[first] |= head;
            words[first + 1..last].fill(u64::MAX);
            words[last] |= tail;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discs_hold_the_pixels_nearer_than_the_distance() {
        // Within a word, across words, over every edge of the image.
        for distance_px in [0.5, 1.0, 3.0, 4.7, 80.0] {
            for [x, y] in [[20, 20], [63, 5], [64, 30], [0, 0], [149, 39]] {
                let mut taken = Taken::default();
                taken.reset([150, 40], distance_px);
                taken.take([x, y]);
                for row in 0..40_usize {
                    for column in 0..150_usize {
                        let (dx, dy) = (column.abs_diff(x) as f64, row.abs_diff(y) as f64);
                        let is_near = distance_px >= 1.0 && dx.hypot(dy) < distance_px;
                        assert_eq!(taken.holds([column, row]), is_near, "{distance_px} {x} {y}");
                    }
                }
            }
        }
    }
}
