//! One cell of drawn junctions: drawn, photographed by a camera, answered by every pipeline, scored.
//!
//! Every junction has its own random numbers, named by what sets its cell apart and by its place in it: more junctions
//! change none, and threads do not matter.

mod shape;

use std::f64::consts::TAU;

use rayon::prelude::*;

use super::DRAWN;
use super::answers::Answers;
use super::score::{failure_record, false_corner, known_corner, of_pipeline, with_reason};
use shape::{SIZE, Shape, ShapeBuffers};

use crate::bound::junction_bound;
use crate::detect::Detection;
use crate::geometry::{Camera, Distortion, ImagePoint};
use crate::plan::{Cell, Factors, Kind, Pipeline, Plan, Seeds};
use crate::random::Stream;
use crate::record::{Record, track};
use crate::refine::Corner;
use crate::sensor::{Colour, Exposure, Kernel, PhotographBuffers, Photographer, Shot};

/// Junctions of a cell do not depend on each other; so many blocks of them stand for scenes in statistics, whose
/// work would else grow with the junctions.
const BLOCKS: u32 = 100;

/// Radius of the disc of pixels that the bound is for \[px\].
const BOUND_RADIUS_PX: f64 = 10.0;

/// With less blur a pixel's nodes are too few for the closed form, and the picture is drawn on a film \[px\].
const LEAST_CLOSED_PX: f64 = 0.45;

/// A cell, and the camera that photographs it.
pub(super) struct Booth<'a> {
    plan: &'a Plan,
    cell: &'a Cell,
    camera: Photographer,
    /// The weights of film cells, where a blur is no Gaussian and the closed form is none.
    kernel: Option<Kernel>,
    /// Names random numbers.
    name: String,
}

/// Memory that a junction needs.
#[derive(Default)]
struct Buffers {
    shape: ShapeBuffers,
    photograph: PhotographBuffers,
}

impl<'a> Booth<'a> {
    /// Puts a camera before a cell.
    pub fn new(plan: &'a Plan, cell: &'a Cell, camera: &Photographer) -> Self {
        let factors = &cell.factors;
        let camera = fitted(factors, camera);
        let optics = &camera.model().optics;
        let is_closed = camera.has_gaussian_blur_alone()
            && optics.gaussian_sigma_px >= LEAST_CLOSED_PX
            && factors.rounding_px == 0.0;
        let kernel = (!is_closed).then(|| camera.kernel(shape::OVERSAMPLING, [0.0; 2]));
        // How many there are is no part of what they are.
        let what = Factors { corners: 0, ..factors.clone() };
        let name = serde_json::json!(what).to_string();
        Self { plan, cell, camera, kernel, name }
    }

    /// The rows of all junctions, in their order.
    pub fn rows(&self) -> Vec<Record> {
        let of_each: Vec<Vec<Record>> = (0..self.cell.factors.count())
            .into_par_iter()
            .map_init(Buffers::default, |buffers, index| self.rows_of(index, buffers))
            .collect();
        of_each.into_iter().flatten().collect()
    }

    fn rows_of(&self, index: u32, buffers: &mut Buffers) -> Vec<Record> {
        let number = index.to_string();
        let name = ["drawn", &self.name, &number];
        let mut random = Stream::named(&name);
        let shape = self.shape(index, &mut random);
        let in_disc = random.in_disc();
        let (exposure, blur_px) = self.photograph(&shape, &name, buffers);
        let bound_px = self.bound_px(&shape, &exposure, blur_px);
        let frame = Frame::of(&shape, bound_px, blur_px);
        let mut records = Vec::new();
        for pipeline in &self.plan.pipelines {
            let template = self.template(pipeline, index, &frame);
            records.extend(frame.records(&template, pipeline, &exposure, in_disc, self.gate_px()));
        }
        records
    }

    fn gate_px(&self) -> f64 {
        self.plan.corner_rule.gate_px
    }

    /// A junction of the cell, turned and placed.
    fn shape(&self, index: u32, random: &mut Stream) -> Shape {
        let factors = &self.cell.factors;
        let at_random = [random.uniform(), random.uniform(), random.uniform()];
        let grid = factors.phase_grid.unwrap_or(1);
        let on_grid = |place: u32| (f64::from(place % grid) + 0.5) / f64::from(grid);
        let place = match factors.phase_grid {
            Some(_) => [on_grid(index), on_grid(index / grid)],
            None => [at_random[0], at_random[1]],
        };
        let turn = match factors.turns {
            // Of an odd multiple of an irrational step none lies along the rows.
            Some(turns) => {
                let cell = index / (grid * grid);
                (f64::from(cell % turns) + 0.381_966) / f64::from(turns)
            }
            None => at_random[2],
        };
        let middle = 0.5 * (SIZE as f64 - 1.0);
        let vertex = place.map(|share| middle + share - 0.5);
        Shape::new(factors, vertex, TAU * turn, random)
    }

    /// Its photograph, and the standard deviation of the blur and the pixel's area \[px\].
    fn photograph(&self, shape: &Shape, name: &[&str], buffers: &mut Buffers) -> (Exposure, f64) {
        let shares = self.cell.factors.surface.shares();
        let Some(kernel) = &self.kernel else {
            let sigma_px = self.camera.model().optics.gaussian_sigma_px;
            let plane = shape.over_pixels(sigma_px, &mut buffers.shape);
            let light = shares.map(|share| plane.map(|sample| share * sample));
            let blur_px = sigma_px.hypot(12.0_f64.sqrt().recip());
            let photograph = self.camera.expose_light(light, blur_px, &frame(), name);
            return (photograph.exposure, blur_px);
        };
        let film = shape.film(shares);
        let shot = Shot { name, window: None };
        let photograph =
            self.camera.expose(&film, &frame(), kernel, &shot, &mut buffers.photograph);
        (photograph.exposure, photograph.blur_px)
    }

    /// What noise allows: of junctions of two or three edges that are alone, levels, ramps, directions and blur unknown.
    fn bound_px(&self, shape: &Shape, exposure: &Exposure, blur_px: f64) -> Option<f64> {
        let factors = &self.cell.factors;
        let is_alone = factors.junction != Kind::X
            && factors.rounding_px == 0.0
            && factors.neighbour_px.is_none_or(|px| px > BOUND_RADIUS_PX + 3.0 * blur_px);
        self.camera.model().sensor.as_ref().filter(|_| is_alone)?;
        let rays = shape.rays(blur_px);
        let covariance = junction_bound(exposure, &rays, BOUND_RADIUS_PX, true)?;
        Some(covariance.trace().sqrt()).filter(|bound| bound.is_finite())
    }

    /// A record with all that is the same for all rows of a junction and method.
    fn template(&self, pipeline: &Pipeline, index: u32, frame: &Frame) -> Record {
        let factors = &self.cell.factors;
        Record {
            suite: DRAWN.to_owned(),
            scene: format!("{} {:02}", self.cell.name, index % BLOCKS),
            family: DRAWN.to_owned(),
            cell: Some(self.cell.name.clone()),
            surface: Some(factors.surface.name().to_owned()),
            gaussian_sigma_px: factors.gaussian_sigma_px,
            defocus_radius_px: factors.defocus_radius_px,
            airy_radius_px: factors.airy_radius_px,
            motion_length_px: factors.motion_length_px,
            contrast_over_noise: factors.contrast_over_noise,
            ramp_per_px: Some(factors.ramp_per_px),
            neighbour_px: factors.neighbour_px,
            rounding_px: Some(factors.rounding_px),
            camera: self.camera.name().to_owned(),
            exposure: i32::try_from(index / BLOCKS).ok(),
            blur_px: Some(frame.blur_px),
            junction: Some(factors.junction.junction().name().to_owned()),
            junction_angle_deg: Some(frame.angle_deg),
            ..of_pipeline(pipeline)
        }
    }
}

/// The true corner and its own frame.
struct Frame {
    vertex: ImagePoint,
    /// Unit vectors along the edges.
    edges: Vec<[f64; 2]>,
    /// Unit vector into the smallest sector's middle.
    inward: [f64; 2],
    /// That sector's opening \[degrees\].
    angle_deg: f64,
    bound_px: Option<f64>,
    blur_px: f64,
}

impl Frame {
    fn of(shape: &Shape, bound_px: Option<f64>, blur_px: f64) -> Self {
        let rays = shape.rays(blur_px);
        let [x, y] = rays.vertex;
        let opening = |sector: &usize| rays.opening_rad(*sector);
        let smallest =
            (0..rays.count).min_by(|a, b| opening(a).total_cmp(&opening(b))).unwrap_or(0);
        let opening_rad = rays.opening_rad(smallest);
        let middle = rays.angles_rad[smallest] + 0.5 * opening_rad;
        let direction = |angle: f64| [angle.cos(), angle.sin()];
        let edges = rays.angles_rad[..rays.count].iter().map(|angle| direction(*angle));
        Self {
            vertex: ImagePoint::new(x, y),
            edges: edges.collect(),
            inward: direction(middle),
            angle_deg: opening_rad.to_degrees(),
            bound_px,
            blur_px,
        }
    }

    /// The rows of a pipeline: of the corner, then of answers elsewhere.
    fn records(
        &self,
        template: &Record,
        pipeline: &Pipeline,
        exposure: &Exposure,
        [right, down]: [f64; 2],
        gate_px: f64,
    ) -> Vec<Record> {
        let given = match &pipeline.seeds {
            Seeds::Disc { radius_px } => {
                let ImagePoint { x, y } = self.vertex;
                let point = ImagePoint::new(x + radius_px * right, y + radius_px * down);
                vec![Detection::new(point, 1.0)]
            }
            Seeds::Detected { .. } | Seeds::Elsewhere(_) => Vec::new(),
        };
        let Answers { mut corners, failure, .. } = Answers::of_corners(pipeline, exposure, &given);
        let template = &with_reason(template, failure.as_ref());
        let far_px = |corner: &Corner| corner.seed.point.distance_px(self.vertex);
        let is_near =
            |corner: &Corner| template.track == track::REFINEMENT || far_px(corner) <= gate_px;
        let nearest = (0..corners.len())
            .filter(|index| is_near(&corners[*index]))
            .min_by(|a, b| far_px(&corners[*a]).total_cmp(&far_px(&corners[*b])));
        let own = nearest.map(|index| corners.remove(index));
        let mut records = vec![self.corner_record(template, own.as_ref())];
        records.extend(corners.iter().map(|corner| {
            let place = self.place(corner.seed.point, gate_px);
            false_corner(template, corner, place, Some(far_px(corner)))
        }));
        records.extend(failure.as_ref().map(|failure| failure_record(template, failure)));
        records
    }

    fn corner_record(&self, template: &Record, answer: Option<&Corner>) -> Record {
        let ImagePoint { x, y } = self.vertex;
        let own = answer.map(|answer| {
            let (dx, dy) = (answer.position.x - x, answer.position.y - y);
            let [along_x, along_y] = self.inward;
            [dx * along_x + dy * along_y, dy * along_x - dx * along_y]
        });
        Record {
            bound_r10_px: self.bound_px,
            refined_along_px: own.map(|[along, _]| along),
            refined_across_px: own.map(|[_, across]| across),
            ..known_corner(template, 0, self.vertex, answer)
        }
    }

    /// Where an answer lies that is not the corner's.
    fn place(&self, point: ImagePoint, gate_px: f64) -> &'static str {
        const NEAR_EDGE_PX: f64 = 3.0;
        let (dx, dy) = (point.x - self.vertex.x, point.y - self.vertex.y);
        let is_on =
            |[x, y]: &[f64; 2]| dx * x + dy * y > 0.0 && (dx * y - dy * x).abs() < NEAR_EDGE_PX;
        if point.distance_px(self.vertex) <= gate_px {
            "duplicate"
        } else if self.edges.iter().any(is_on) {
            "edge"
        } else {
            "background"
        }
    }
}

/// The camera with the cell's blur and noise instead of its own.
fn fitted(factors: &Factors, camera: &Photographer) -> Photographer {
    let mut model = camera.model().clone();
    let optics = &mut model.optics;
    // What is drawn stands in the middle of the image.
    optics.distortion = Distortion::NONE;
    optics.corner_illumination = 1.0;
    for (own, given) in [
        (&mut optics.gaussian_sigma_px, factors.gaussian_sigma_px),
        (&mut optics.defocus_radius_px, factors.defocus_radius_px),
        (&mut optics.airy_radius_px, factors.airy_radius_px),
        (&mut optics.motion_length_px, factors.motion_length_px),
    ] {
        *own = given.unwrap_or(*own);
    }
    if let (Some(sensor), Some(ratio)) = (&mut model.sensor, factors.contrast_over_noise) {
        let electrons = sensor.electrons_at_one();
        // Of the channel that sees most.
        let most = match model.colour {
            Colour::Mono => electrons.iter().sum(),
            Colour::Rgb | Colour::Rggb => electrons.iter().copied().fold(0.0, f64::max),
        };
        sensor.read_noise_e = most * factors.contrast() / ratio;
    }
    camera.with_model(&model)
}

/// The frame of the pictures.
fn frame() -> Camera {
    #[allow(clippy::cast_possible_truncation, reason = "tens of pixels")]
    let size = SIZE as u32;
    Camera::pinhole(size, size, 1000.0)
}
