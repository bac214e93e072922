//! COCO keypoints: one image a scene, the target's corners as keypoints, its visible mask as run lengths.

use std::fs;
use std::path::{Path, PathBuf};

use image::RgbImage;
use serde::Serialize;

use super::{Writer, save, visible_mask};
use crate::error::{Error, Result};
use crate::image::Plane;
use crate::scene::{Description, Scene, TrueCorner, Truth, Visibility};

/// An export to COCO, growing.
pub(super) struct Coco {
    folder: PathBuf,
    content: Content,
}

#[derive(Serialize)]
struct Content {
    info: Info,
    licenses: [(); 0],
    images: Vec<Image>,
    annotations: Vec<Annotation>,
    categories: Vec<Category>,
}

#[derive(Serialize)]
struct Info {
    description: String,
    version: String,
}

#[derive(Serialize)]
struct Image {
    id: usize,
    file_name: String,
    width: usize,
    height: usize,
}

#[derive(Serialize)]
struct Annotation {
    id: usize,
    image_id: usize,
    category_id: usize,
    iscrowd: u8,
    segmentation: RunLengths,
    /// Pixels of the segmentation.
    area: usize,
    /// Left, top, width, height of the segmentation's pixels, areas included.
    bbox: [usize; 4],
    /// x, y, v of each corner.
    keypoints: Vec<f64>,
    /// Corners with v > 0.
    num_keypoints: usize,
}

/// A mask column by column: lengths of runs, the first of pixels outside it.
#[derive(Serialize)]
struct RunLengths {
    /// Rows, columns.
    size: [usize; 2],
    counts: Vec<usize>,
}

#[derive(Serialize)]
struct Category {
    id: usize,
    name: String,
    supercategory: String,
    keypoints: Vec<String>,
    /// Pairs of keypoints, counted from 1.
    skeleton: Vec<[usize; 2]>,
}

impl Coco {
    pub(super) fn new(folder: &Path, suite: &str, camera: &str) -> Self {
        let info = Info {
            description: format!("cornerbench suite {suite}, camera {camera}"),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        let content = Content {
            info,
            licenses: [],
            images: Vec::new(),
            annotations: Vec::new(),
            categories: Vec::new(),
        };
        Self { folder: folder.to_owned(), content }
    }

    /// The category of targets of a kind with these corners and edges.
    fn category(&mut self, kind: &str, truth: &Truth) -> usize {
        let keypoints: Vec<String> =
            (0..truth.corners.len()).map(|corner| format!("vertex{corner}")).collect();
        let skeleton: Vec<[usize; 2]> =
            truth.edges.iter().map(|edge| edge.corners.map(|corner| corner + 1)).collect();
        let categories = &mut self.content.categories;
        let known = categories.iter().find(|known| {
            (known.supercategory.as_str(), &known.keypoints, &known.skeleton)
                == (kind, &keypoints, &skeleton)
        });
        if let Some(known) = known {
            return known.id;
        }
        let id = categories.len() + 1;
        categories.push(Category {
            id,
            name: format!("{kind}-{}", keypoints.len()),
            supercategory: kind.to_owned(),
            keypoints,
            skeleton,
        });
        id
    }
}

impl Writer for Coco {
    fn add(&mut self, place: usize, scene: &Scene, picture: &RgbImage) -> Result<()> {
        // From 1: pycocotools takes an annotation of id 0 for none.
        let id = place + 1;
        let file_name = format!("{}.png", scene.name);
        save(&self.folder.join("images").join(&file_name), picture)?;
        let mask = visible_mask(scene);
        let (width, height) = (mask.width(), mask.height());
        self.content.images.push(Image { id, file_name, width, height });
        let category_id = self.category(scene.description.target.kind.name(), &scene.truth);
        // A target of which nothing is seen is not annotated: the image is one without a target.
        let Some(range) = mask.range() else { return Ok(()) };
        let keypoints = keypoints(&scene.description, &scene.truth);
        self.content.annotations.push(Annotation {
            id,
            image_id: id,
            category_id,
            iscrowd: 0,
            segmentation: run_lengths(&mask),
            area: mask.samples().iter().filter(|&&inside| inside).count(),
            bbox: [range.x0, range.y0, range.width(), range.height()],
            num_keypoints: keypoints.iter().skip(2).step_by(3).filter(|v| **v > 0.0).count(),
            keypoints,
        });
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        let path = self.folder.join("annotations.json");
        let text =
            serde_json::to_vec(&self.content).map_err(|error| Error::malformed(&path, error))?;
        fs::write(&path, text).map_err(Error::io(&path, "write"))
    }
}

/// x, y, v of each corner; 0, 0, 0 outside the image.
fn keypoints(description: &Description, truth: &Truth) -> Vec<f64> {
    let of_corner = |corner: &TrueCorner| {
        let point = corner.image_point_px;
        // A corner that the target itself hides is called that outside the image, too.
        match corner.visibility {
            _ if !description.camera.contains(point) => [0.0, 0.0, 0.0],
            Visibility::Outside => [0.0, 0.0, 0.0],
            Visibility::Visible => [point.x, point.y, 2.0],
            Visibility::Occluded | Visibility::SelfOccluded => [point.x, point.y, 1.0],
        }
    };
    truth.corners.iter().flat_map(of_corner).collect()
}

fn run_lengths(mask: &Plane<bool>) -> RunLengths {
    let mut counts = vec![0];
    let mut inside = false;
    for x in 0..mask.width() {
        for y in 0..mask.height() {
            if mask.at(x, y) != inside {
                inside = !inside;
                counts.push(0);
            }
            if let Some(last) = counts.last_mut() {
                *last += 1;
            }
        }
    }
    RunLengths { size: [mask.height(), mask.width()], counts }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_go_down_the_columns_and_begin_outside() {
        let counts = |width, rows: &[bool]| {
            let height = rows.len() / width;
            run_lengths(&Plane::from_samples(width, height, rows.to_vec())).counts
        };
        assert_eq!(counts(2, &[false, true, false, true, true, false]), [2, 3, 1]);
        assert_eq!(counts(2, &[true, false, true, false]), [0, 2, 2]);
    }
}
