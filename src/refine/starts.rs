//! Where a junction's rays may be: edges that cross three of four circles about a place in a line, and meet.

use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::junction::rays::{MOST_RAYS, Rays};

/// Where circles are about the seed \[px\]: beyond the vertex, and within what is near.
const RADII_PX: [f64; 4] = [4.5, 6.5, 8.5, 10.5];
/// Places on a circle.
const PLACES: usize = 64;
/// From one to the next \[rad\].
const TURN: f64 = std::f64::consts::TAU / PLACES as f64;
/// Edges on a circle, and edges in all.
const MOST_CROSSINGS: usize = 8;
const MOST_EDGES: usize = 16;
/// Starts that are tried.
pub const MOST_STARTS: usize = 4;

/// Where an edge crosses a circle.
#[derive(Clone, Copy, Debug, Default)]
struct Crossing {
    place: [f64; 2],
    /// The step across it in each channel, over the noise.
    step: [f64; 3],
    energy: f64,
}

/// A straight edge that leaves the middle.
#[derive(Clone, Copy, Debug, Default)]
struct Edge {
    /// A point on it, far out.
    outer: [f64; 2],
    /// Its direction outwards.
    direction: [f64; 2],
    energy: f64,
}

/// Where to start from.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    pub rays: Rays,
    /// Whether two straight edges cross there.
    pub is_crossing: bool,
    score: f64,
}

/// Starts about a seed, the best first; few, or none.
#[derive(Clone, Debug)]
pub struct Starts {
    pub found: Vec<Start>,
    /// Cosines and sines of the places on a circle.
    turns: [[f64; 2]; PLACES],
    crossings: [Vec<Crossing>; 4],
    edges: Vec<Edge>,
}

impl Default for Starts {
    fn default() -> Self {
        let turn = |place: usize| {
            let (sine, cosine) = (TURN * place as f64).sin_cos();
            [cosine, sine]
        };
        Self {
            found: Vec::new(),
            turns: std::array::from_fn(turn),
            crossings: Default::default(),
            edges: Vec::new(),
        }
    }
}

impl Starts {
    /// Looks about a seed; `deviations` are those of the noise in each plane.
    pub fn look(
        &mut self,
        planes: &[Plane<f32>],
        deviations: &[f64; 3],
        seed: ImagePoint,
        max_shift_px: f64,
    ) {
        for (radius_px, crossings) in RADII_PX.into_iter().zip(&mut self.crossings) {
            cross(planes, deviations, seed, radius_px, &self.turns, crossings);
        }
        self.connect();
        self.meet(max_shift_px);
        for start in &mut self.found {
            start.rays.vertex[0] += seed.x;
            start.rays.vertex[1] += seed.y;
        }
    }

    /// Crossings of three circles that lie in a line are an edge.
    fn connect(&mut self) {
        const OFF_PX: f64 = 0.8;
        self.edges.clear();
        for circles in self.crossings.windows(3) {
            let [inner, middle, outer] = circles else { continue };
            for a in inner {
                for c in outer {
                    let along = [c.place[0] - a.place[0], c.place[1] - a.place[1]];
                    let length = along[0].hypot(along[1]);
                    let direction = along.map(|value| value / length);
                    // From the middle outwards, not along a circle.
                    if length > 7.5 || agreement(&a.step, &c.step) < 0.5 {
                        continue;
                    }
                    let off = |b: &Crossing| {
                        let from = [b.place[0] - a.place[0], b.place[1] - a.place[1]];
                        (from[0] * direction[1] - from[1] * direction[0]).abs()
                    };
                    let nearest = middle
                        .iter()
                        .filter(|b| agreement(&a.step, &b.step) > 0.5)
                        .min_by(|b, d| off(b).total_cmp(&off(d)));
                    let Some(b) = nearest.filter(|b| off(b) < OFF_PX) else { continue };
                    let energy = a.energy.min(b.energy).min(c.energy);
                    self.edges.push(Edge { outer: c.place, direction, energy });
                }
            }
        }
        self.edges.sort_by(|a, b| b.energy.total_cmp(&a.energy));
        self.edges.truncate(MOST_EDGES);
    }

    /// Edges that leave one point.
    fn meet(&mut self, max_shift_px: f64) {
        const OFF_PX: f64 = 1.2;
        const LEAST_SINE: f64 = 0.2;
        self.found.clear();
        for (index, a) in self.edges.iter().enumerate() {
            for b in &self.edges[index + 1..] {
                let sine = a.direction[0] * b.direction[1] - a.direction[1] * b.direction[0];
                if sine.abs() < LEAST_SINE {
                    continue;
                }
                let between = [b.outer[0] - a.outer[0], b.outer[1] - a.outer[1]];
                let far = (between[0] * b.direction[1] - between[1] * b.direction[0]) / sine;
                let vertex = [a.outer[0] + far * a.direction[0], a.outer[1] + far * a.direction[1]];
                let shift_px = vertex[0].hypot(vertex[1]);
                if shift_px > max_shift_px {
                    continue;
                }
                let mut rays: [(f64, f64); MOST_EDGES] = Default::default();
                let mut count = 0;
                for edge in &self.edges {
                    let from = [edge.outer[0] - vertex[0], edge.outer[1] - vertex[1]];
                    let off = from[0] * edge.direction[1] - from[1] * edge.direction[0];
                    let along = from[0] * edge.direction[0] + from[1] * edge.direction[1];
                    if off.abs() > OFF_PX || along < 1.0 {
                        continue;
                    }
                    let angle = from[1].atan2(from[0]);
                    let is_new = rays[..count].iter().all(|(other, _)| {
                        let turn = (angle - other).rem_euclid(std::f64::consts::TAU);
                        turn.min(std::f64::consts::TAU - turn) > 0.3
                    });
                    if is_new {
                        rays[count] = (angle, edge.energy);
                        count += 1;
                    }
                }
                if count < 2 {
                    continue;
                }
                // The strongest come first.
                let is_crossing = crosses(&rays[..count]);
                let used = count.min(MOST_RAYS);
                let energy: f64 = rays[..used].iter().map(|ray| ray.1.sqrt()).sum();
                let mut angles_rad = [0.0; MOST_RAYS];
                for (angle, ray) in angles_rad.iter_mut().zip(&rays[..used]) {
                    *angle = ray.0;
                }
                angles_rad[..used].sort_by(f64::total_cmp);
                let rays = Rays { vertex, sigma_px: 1.0, count: used, angles_rad };
                let score = energy * (-shift_px * shift_px / 32.0).exp();
                self.found.push(Start { rays, is_crossing, score });
            }
        }
        self.found.sort_by(|a, b| b.score.total_cmp(&a.score));
        // Others at the same place are the same.
        let mut kept = 0;
        for index in 0..self.found.len() {
            let vertex = self.found[index].rays.vertex;
            let is_new = self.found[..kept].iter().all(|start| {
                let other = start.rays.vertex;
                (other[0] - vertex[0]).hypot(other[1] - vertex[1]) > 1.0
            });
            if is_new && kept < MOST_STARTS {
                self.found.swap(kept, index);
                kept += 1;
            }
        }
        self.found.truncate(kept);
    }
}

/// Whether the four strongest rays, angles and energies, are two straight edges of about one strength.
fn crosses(rays: &[(f64, f64)]) -> bool {
    const STRAIGHT_RAD: f64 = 0.3;
    const LEAST_SHARE: f64 = 0.1;
    let Some(four) = rays.first_chunk::<4>() else { return false };
    let is_opposite = |a: usize, b: usize| {
        let turn = (four[a].0 - four[b].0).rem_euclid(std::f64::consts::TAU);
        (turn - std::f64::consts::PI).abs() < STRAIGHT_RAD
    };
    let are_opposite = |[a, b, c, d]: [usize; 4]| is_opposite(a, b) && is_opposite(c, d);
    four[3].1 > LEAST_SHARE * four[0].1
        && [[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2]].into_iter().any(are_opposite)
}

/// The cosine between steps of two crossings.
fn agreement(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let product = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    product(a, b) / (product(a, a) * product(b, b)).sqrt().max(f64::MIN_POSITIVE)
}

/// Where the samples on a circle step, relative to its middle.
fn cross(
    planes: &[Plane<f32>],
    deviations: &[f64; 3],
    middle: ImagePoint,
    radius_px: f64,
    turns: &[[f64; 2]; PLACES],
    crossings: &mut Vec<Crossing>,
) {
    crossings.clear();
    // To each side of a place a mean over so much of the circle.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
    let side = ((2.5 / (TURN * radius_px)).round() as usize).max(2);
    let mut steps = [[0.0; 3]; PLACES];
    for (channel, plane) in planes.iter().enumerate() {
        let samples: [f64; PLACES] = std::array::from_fn(|place| {
            let [cosine, sine] = turns[place];
            plane.bilinear(ImagePoint::new(
                middle.x + radius_px * cosine,
                middle.y + radius_px * sine,
            ))
        });
        let mut sum: f64 = (0..side).map(|i| samples[i] - samples[PLACES - 1 - i]).sum();
        for (place, step) in steps.iter_mut().enumerate() {
            step[channel] = sum / (side as f64 * deviations[channel]);
            let at = |offset: usize| samples[(place + PLACES + offset - side) % PLACES];
            sum += at(2 * side) - 2.0 * at(side) + at(0);
        }
    }
    let energies: [f64; PLACES] =
        std::array::from_fn(|place| steps[place].iter().map(|step| step * step).sum());
    let most = energies.iter().copied().fold(0.0, f64::max);
    // Of noise alone the energy of a channel is about 2 / (side pixels): three deviations.
    let pixels = (side as f64 * TURN * radius_px).max(1.0);
    let least = (18.0 * planes.len() as f64 / pixels).max(1e-3 * most);
    for place in 0..PLACES {
        let at = |offset: usize| energies[(place + PLACES + offset - side) % PLACES];
        let energy = at(side);
        let is_largest = (1..=side / 2 + 1)
            .all(|offset| energy > at(side - offset.min(side)) && energy >= at(side + offset));
        if energy < least || !is_largest {
            continue;
        }
        let (before, after) = (at(side - 1), at(side + 1));
        let bend = before - 2.0 * energy + after;
        let shift = if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
        // A step at a place lies between it and the place before.
        let (sine, cosine) = (TURN * (place as f64 - 0.5 + shift)).sin_cos();
        let place_px = [radius_px * cosine, radius_px * sine];
        crossings.push(Crossing { place: place_px, step: steps[place], energy });
    }
    crossings.sort_by(|a, b| b.energy.total_cmp(&a.energy));
    crossings.truncate(MOST_CROSSINGS);
}
