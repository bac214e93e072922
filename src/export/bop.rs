//! The BOP challenge's format, "scenewise": one BOP scene with one image a scene.
//!
//! The images of a BOP scene share a world, and those of two of our scenes do not. Targets of one kind
//! and size share a model.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use image::RgbImage;
use nalgebra::{Matrix3, Point3, Translation3, Vector3};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::{Writer, grey, save, target_box, visible_mask};
use crate::error::{Error, Result};
use crate::files::write_json;
use crate::geometry::{Camera, ImagePoint, Pose};
use crate::image::{PixelRange, Plane};
use crate::scene::{Scene, TargetKind};

/// The image of every BOP scene, and the annotation of every image.
const ONLY: usize = 0;
/// A pose counts as a test target when at least this share of the object is seen, as with the BOP
/// challenge's own datasets.
const LEAST_VISIBLE_FRACTION: f64 = 0.1;
/// Sides of a box that differ by less, relative to their length, are equal.
const EQUAL: f64 = 1e-9;

/// An export to BOP, growing.
pub(super) struct Bop {
    folder: PathBuf,
    /// Kinds of the models, and their sizes \[m\]; model i is object i + 1.
    models: Vec<(TargetKind, [f64; 3])>,
    targets: Vec<Value>,
    camera: Option<Value>,
}

impl Bop {
    pub(super) fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), models: Vec::new(), targets: Vec::new(), camera: None }
    }

    /// The object of this kind and size.
    fn object(&mut self, kind: TargetKind, size_m: [f64; 3]) -> usize {
        // The same numbers make the same model, no others do.
        let known = self.models.iter().position(|known| *known == (kind, size_m));
        1 + known.unwrap_or_else(|| {
            self.models.push((kind, size_m));
            self.models.len() - 1
        })
    }
}

impl Writer for Bop {
    fn add(&mut self, place: usize, scene: &Scene, picture: &RgbImage) -> Result<()> {
        let description = &scene.description;
        let camera = &description.camera;
        let folder = self.folder.join(format!("test/{place:06}"));
        let image = format!("{ONLY:06}.png");
        let annotation = format!("{ONLY:06}_{ONLY:06}.png");

        let depth = Depth::of(&scene.geometry.depth_m);
        let visible = visible_mask(scene);
        let outline = outline(&target_box(description), camera, &visible);
        let whole = outline.crop(frame_of(&visible));
        save(&folder.join("rgb").join(&image), picture)?;
        save(&folder.join("depth").join(&image), &grey(&depth.steps, |step| step))?;
        let white = |inside: bool| if inside { 255_u8 } else { 0 };
        save(&folder.join("mask").join(&annotation), &grey(&whole, white))?;
        save(&folder.join("mask_visib").join(&annotation), &grey(&visible, white))?;

        let camera_from_world = description.world_from_camera.inverse();
        // A BOP model's origin is the centre of its box.
        let size_m = description.target.size_m;
        let target_from_model = Translation3::new(0.0, 0.0, 0.5 * size_m[2]);
        let camera_from_model =
            camera_from_world * description.target.world_from_target * target_from_model;
        let object = self.object(description.target.kind, size_m);
        let (world_rotation, world_mm) = rotation_and_translation_mm(&camera_from_world);
        let (model_rotation, model_mm) = rotation_and_translation_mm(&camera_from_model);
        let of_image = |content: Value| Map::from_iter([(ONLY.to_string(), content)]);
        write_json(
            &folder.join("scene_camera.json"),
            &of_image(json!({
                "cam_K": [
                    camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0
                ],
                "cam_R_w2c": world_rotation,
                "cam_t_w2c": world_mm,
                "depth_scale": depth.step_mm,
            })),
        )?;
        write_json(
            &folder.join("scene_gt.json"),
            &of_image(json!([{
                "cam_R_m2c": model_rotation,
                "cam_t_m2c": model_mm,
                "obj_id": object,
            }])),
        )?;
        let info = Info::of(&outline, &visible, &depth.steps);
        write_json(&folder.join("scene_gt_info.json"), &of_image(json!([info])))?;
        if info.visib_fract >= LEAST_VISIBLE_FRACTION {
            self.targets.push(json!({
                "im_id": ONLY, "inst_count": 1, "obj_id": object, "scene_id": place,
            }));
        }
        self.camera.get_or_insert_with(|| {
            json!({
                "cx": camera.cx_px,
                "cy": camera.cy_px,
                "depth_scale": depth.step_mm,
                "fx": camera.fx_px,
                "fy": camera.fy_px,
                "height": camera.height,
                "width": camera.width,
            })
        });
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        write_json(&self.folder.join("camera.json"), &self.camera)?;
        write_json(&self.folder.join("test_targets_bop19.json"), &self.targets)?;
        // The toolkit's evaluation reads models with evenly spread vertices from a folder of their own.
        // Of a box the vertices are those that move farthest, so it is the same model.
        for name in ["models", "models_eval"] {
            let folder = self.folder.join(name);
            fs::create_dir_all(&folder).map_err(Error::io(&folder, "create"))?;
            let mut info = Map::new();
            for (index, (kind, size_m)) in self.models.iter().enumerate() {
                let object = index + 1;
                let path = folder.join(format!("obj_{object:06}.ply"));
                fs::write(&path, ply(size_m)).map_err(Error::io(&path, "write"))?;
                info.insert(object.to_string(), model_info(*kind, size_m));
            }
            write_json(&folder.join("models_info.json"), &info)?;
        }
        Ok(())
    }
}

/// Depth in steps of 16 bits; 0 where nothing was met.
struct Depth {
    steps: Plane<u16>,
    step_mm: f64,
}

impl Depth {
    /// In steps of 0.1 mm, or of the least multiple of it in which the farthest depth fits.
    fn of(depth_m: &Plane<f32>) -> Self {
        let farthest_mm = 1e3 * f64::from(depth_m.samples().iter().copied().fold(0.0, f32::max));
        let tenths = (farthest_mm / (0.1 * f64::from(u16::MAX))).ceil().max(1.0);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "fits 16 bits")]
        let steps = depth_m.map(|depth| (1e4 * f64::from(depth) / tenths).round() as u16);
        Self { steps, step_mm: tenths / 10.0 }
    }
}

/// Where the image lies on a canvas that reaches its own width and height farther on every side.
fn frame_of(image: &Plane<bool>) -> PixelRange {
    let (width, height) = (image.width(), image.height());
    PixelRange { x0: width, y0: height, x1: 2 * width, y1: 2 * height }
}

/// The pixels of the target as if nothing were before it, on the canvas of [`frame_of`], on which
/// `bop_toolkit` counts, too: those whose centres the convex hull of the vertices' projections covers.
/// What is visible belongs to them: the renderer's rays are single precision and may meet what the
/// hull just misses.
#[allow(clippy::cast_precision_loss, reason = "columns and rows")]
fn outline(vertices: &[Point3<f64>], camera: &Camera, visible: &Plane<bool>) -> Plane<bool> {
    let points: Vec<ImagePoint> = vertices.iter().filter_map(|v| camera.project(v)).collect();
    let frame = frame_of(visible);
    let (width, height) = (3 * visible.width(), 3 * visible.height());
    let spans: Vec<(f64, f64)> =
        (0..height).map(|y| span(&points, y as f64 - frame.y0 as f64)).collect();
    Plane::from_fn(width, height, |x, y| {
        let (left, right) = spans[y];
        let in_frame = (frame.x0..frame.x1).contains(&x) && (frame.y0..frame.y1).contains(&y);
        (left..=right).contains(&(x as f64 - frame.x0 as f64))
            || in_frame && visible.at(x - frame.x0, y - frame.y0)
    })
}

/// Where the horizontal line at `y` enters and leaves the convex hull of `points`; the first number is
/// the larger where it does not meet it.
fn span(points: &[ImagePoint], y: f64) -> (f64, f64) {
    let pairs =
        points.iter().enumerate().flat_map(|(i, a)| points[..i].iter().map(move |b| (a, b)));
    // The hull's section is the hull of the sections of all lines between two of its points.
    let crossings = pairs.filter(|(a, b)| (a.y - y) * (b.y - y) <= 0.0).flat_map(|(a, b)| {
        let share = (y - a.y) / (b.y - a.y);
        if share.is_finite() { [a.x + share * (b.x - a.x); 2] } else { [a.x, b.x] }
    });
    crossings
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(left, right), x| (left.min(x), right.max(x)))
}

/// How much of an object is where, as `scene_gt_info.json` has it.
///
/// A box is its first column and row and the distance to its last ones, one less than their number; -1
/// for an object of which nothing is seen: so does `bop_toolkit`.
#[derive(Serialize)]
struct Info {
    bbox_obj: [isize; 4],
    bbox_visib: [isize; 4],
    px_count_all: usize,
    px_count_valid: usize,
    px_count_visib: usize,
    visib_fract: f64,
}

impl Info {
    fn of(outline: &Plane<bool>, visible: &Plane<bool>, depth: &Plane<u16>) -> Self {
        let count = |mask: &Plane<bool>| mask.samples().iter().filter(|&&inside| inside).count();
        let frame = frame_of(visible);
        let whole = outline.crop(frame);
        let met = whole.samples().iter().zip(depth.samples());
        let boxed = |range: PixelRange, x0: usize, y0: usize| {
            let from = |edge: usize, zero: usize| edge.cast_signed() - zero.cast_signed();
            [
                from(range.x0, x0),
                from(range.y0, y0),
                from(range.x1, range.x0 + 1),
                from(range.y1, range.y0 + 1),
            ]
        };
        let (bbox_obj, bbox_visib) = match (outline.range(), visible.range()) {
            (Some(all), Some(visible)) => (boxed(all, frame.x0, frame.y0), boxed(visible, 0, 0)),
            _ => ([-1; 4], [-1; 4]),
        };
        let (all, seen) = (count(outline), count(visible));
        #[allow(clippy::cast_precision_loss, reason = "counts of pixels")]
        let visib_fract = if all == 0 { 0.0 } else { seen as f64 / all as f64 };
        Self {
            bbox_obj,
            bbox_visib,
            px_count_all: all,
            px_count_valid: met.filter(|(inside, depth)| **inside && **depth > 0).count(),
            px_count_visib: seen,
            visib_fract,
        }
    }
}

/// A rotation's rows in one list, and a translation \[mm\].
fn rotation_and_translation_mm(pose: &Pose) -> (Vec<f64>, [f64; 3]) {
    let rotation: Matrix3<f64> = pose.rotation.to_rotation_matrix().into_inner();
    let rows = rotation.transpose().iter().copied().collect();
    (rows, (1e3 * pose.translation.vector).into())
}

/// Faces of the box, counter-clockwise seen from outside.
const FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// A box in millimetres about the origin, its vertices in the order of truth.json's corners, with the
/// angle-weighted normals that BOP's models have.
fn ply(size_m: &[f64; 3]) -> String {
    let mut text = String::from(
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n\
         property float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
         element face 12\nproperty list uchar int vertex_indices\nend_header\n",
    );
    for index in 0..8 {
        let sign = [0, 1, 2].map(|axis| if index >> axis & 1 == 1 { 1.0 } else { -1.0 });
        let [x, y, z] = [0, 1, 2].map(|axis| sign[axis] * 0.5 * size_mm(size_m)[axis]);
        let [nx, ny, nz] = sign.map(|sign| sign / 3.0_f64.sqrt());
        let _ = writeln!(text, "{x} {y} {z} {nx} {ny} {nz}");
    }
    for [a, b, c, d] in FACES {
        let _ = writeln!(text, "3 {a} {b} {c}\n3 {a} {c} {d}");
    }
    text
}

fn size_mm(size_m: &[f64; 3]) -> [f64; 3] {
    size_m.map(|side| 1e3 * side)
}

fn model_info(kind: TargetKind, size_m: &[f64; 3]) -> Value {
    let [length, width, height] = size_mm(size_m);
    json!({
        "diameter": Vector3::new(length, width, height).norm(),
        "min_x": -0.5 * length,
        "min_y": -0.5 * width,
        "min_z": -0.5 * height,
        "size_x": length,
        "size_y": width,
        "size_z": height,
        "symmetries_discrete": symmetries(kind, size_m),
    })
}

/// The rotations other than the identity that take a target onto itself, as 4 x 4 matrices row by row:
/// of a box half turns about the axes, more where sides are equal; of a board those of them that leave
/// its pattern above. (Its squares are odd in number along both sides: the pattern turns with it.)
fn symmetries(kind: TargetKind, size_m: &[f64; 3]) -> Vec<[f64; 16]> {
    const ORDERS: [[usize; 3]; 6] =
        [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let mut found = Vec::new();
    for (order, signs) in ORDERS.iter().flat_map(|order| (0..8).map(move |signs| (order, signs))) {
        let matrix =
            Matrix3::from_fn(|row, column| match (order[row] == column, signs >> row & 1) {
                (false, _) => 0.0,
                (true, 0) => 1.0,
                (true, _) => -1.0,
            });
        let fits = (0..3).all(|row| {
            let (here, there) = (size_m[row], size_m[order[row]]);
            (here - there).abs() <= EQUAL * here.max(there)
        });
        let upright = kind == TargetKind::Cuboid || matrix[(2, 2)] > 0.0;
        if fits && upright && matrix.determinant() > 0.0 && matrix != Matrix3::identity() {
            let rows = matrix.to_homogeneous().transpose();
            found.push(std::array::from_fn(|place| rows[place]));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Distortion;

    #[test]
    fn a_box_has_three_half_turns_and_more_where_sides_are_equal() {
        let count = |size_m| symmetries(TargetKind::Cuboid, &size_m).len();
        assert_eq!(count([0.1, 0.2, 0.3]), 3);
        assert_eq!(count([0.2, 0.2, 0.3]), 7);
        assert_eq!(count([0.3, 0.2, 0.3]), 7);
        assert_eq!(count([0.2, 0.2, 0.2]), 23);
    }

    #[test]
    fn a_board_turns_about_its_normal_alone() {
        let turns = |size_m| symmetries(TargetKind::Board, &size_m);
        assert_eq!(turns([0.3, 0.2, 0.004]).len(), 1);
        assert_eq!(turns([0.2, 0.2, 0.004]).len(), 3);
        assert!(turns([0.2, 0.2, 0.2]).iter().all(|turn| turn[10] > 0.0), "the third axis stays");
    }

    #[test]
    fn targets_of_one_kind_and_size_share_a_model() {
        use TargetKind::{Board, Cuboid};
        let mut export = Bop::new(Path::new("unused"));
        let (long, square) = ([0.1, 0.2, 0.3], [0.2, 0.2, 0.3]);
        let targets = [(Cuboid, long), (Cuboid, square), (Cuboid, long), (Board, long)];
        assert_eq!(targets.map(|(kind, size_m)| export.object(kind, size_m)), [1, 2, 1, 3]);
        assert_eq!(export.models, [targets[0], targets[1], targets[3]]);
    }

    #[test]
    fn depth_beyond_sixteen_bits_takes_larger_steps() {
        let depth = |metres: f32| Depth::of(&Plane::from_samples(2, 1, vec![0.0, metres]));
        let near = depth(6.553);
        assert_eq!((near.steps.samples(), near.step_mm), (&[0, 65530][..], 0.1));
        let far = depth(6.554);
        assert_eq!((far.steps.samples(), far.step_mm), (&[0, 32770][..], 0.2));
    }

    #[test]
    fn a_line_enters_and_leaves_a_hull_where_its_sides_are() {
        let triangle = [[0.0, 0.0], [4.0, 4.0], [8.0, 0.0]].map(ImagePoint::from);
        assert_eq!(span(&triangle, 0.0), (0.0, 8.0));
        assert_eq!(span(&triangle, 1.0), (1.0, 7.0));
        assert_eq!(span(&triangle, 4.0), (4.0, 4.0));
        let (left, right) = span(&triangle, 4.5);
        assert!(left > right);
    }

    #[test]
    fn what_lies_outside_the_image_counts_as_far_as_one_image_away() {
        let camera = Camera {
            width: 10,
            height: 10,
            fx_px: 1.0,
            fy_px: 1.0,
            cx_px: 0.0,
            cy_px: 0.0,
            distortion: Distortion::NONE,
        };
        let rectangle = |x: [f64; 2], y: [f64; 2]| {
            [0, 1, 2, 3].map(|corner| Point3::new(x[corner & 1], y[corner >> 1], 1.0))
        };
        let nothing = Plane::filled(10, 10, false);
        let depth = Plane::filled(10, 10, 1);
        let half_in = outline(&rectangle([-5.0, 4.5], [2.0, 3.5]), &camera, &nothing);
        assert_eq!(half_in.range(), Some(PixelRange { x0: 5, y0: 12, x1: 15, y1: 14 }));
        let info = Info::of(&half_in, &nothing, &depth);
        assert_eq!((info.px_count_all, info.px_count_valid, info.px_count_visib), (20, 10, 0));
        assert_eq!(info.bbox_obj, [-1; 4]);
        let visible = Plane::from_fn(10, 10, |x, y| x == 4 && y == 2);
        let info = Info::of(&half_in, &visible, &depth);
        assert_eq!((info.bbox_obj, info.bbox_visib), ([-5, 2, 9, 1], [4, 2, 0, 0]));
        let huge = outline(&rectangle([-1e12, 1e12], [-1e12, 1e12]), &camera, &nothing);
        assert_eq!(Info::of(&huge, &nothing, &depth).px_count_all, 900);
    }

    #[test]
    fn what_is_visible_belongs_to_the_whole() {
        let camera = Camera {
            width: 4,
            height: 4,
            fx_px: 1.0,
            fy_px: 1.0,
            cx_px: 0.0,
            cy_px: 0.0,
            distortion: Distortion::NONE,
        };
        let visible = Plane::from_fn(4, 4, |x, y| x == 3 && y == 1);
        let whole =
            outline(&[Point3::new(1.0, 1.0, 1.0); 2], &camera, &visible).crop(frame_of(&visible));
        let expected = Plane::from_fn(4, 4, |x, y| y == 1 && (x == 1 || x == 3));
        assert_eq!(whole, expected);
    }
}
