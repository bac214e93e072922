//! Our answers beside OpenCV's, on the same picture and seeds.

use std::fs;
use std::path::Path;
use std::process::Command;

use proptest::prelude::Rng;
use proptest::test_runner::{RngAlgorithm, TestRng};

use cornerbench::detect::fast::Fast;
use cornerbench::detect::good_features::GoodFeatures;
use cornerbench::detect::harris::Harris;
use cornerbench::detect::shi_tomasi::ShiTomasi;
use cornerbench::detect::tensor::{Derivative, Measure, StructureTensor, TensorBuffers, Window};
use cornerbench::detect::{Detection, Detector};
use cornerbench::filter::Border;
use cornerbench::geometry::ImagePoint;
use cornerbench::image::Plane;
use cornerbench::junction::BlurredJunction;
use cornerbench::refine::Refiner;
use cornerbench::refine::corner_sub_pix::CornerSubPix;
use cornerbench::sensor::Exposure;

use crate::support::{project, python, succeed};

/// A picture of wedges and Ys, four to a hundred pixels, blurred and noisy; and where they meet.
fn noisy_junctions(random: &mut TestRng) -> (Plane<f32>, Vec<ImagePoint>) {
    const SIDE_PX: usize = 24;
    const COUNT: [usize; 2] = [16, 12];
    let mut uniform =
        |from: f64, to: f64| from + (to - from) * f64::from(random.next_u32()) / 4_294_967_296.0;
    let junctions: Vec<BlurredJunction> = (0..COUNT[0] * COUNT[1])
        .map(|_| {
            let vertex = ImagePoint::new(uniform(9.0, 14.0), uniform(9.0, 14.0));
            let (first, opening) = (uniform(0.0, std::f64::consts::TAU), uniform(0.7, 2.4));
            let levels = [uniform(30.0, 100.0), uniform(150.0, 220.0), uniform(100.0, 150.0)];
            let edges = [first, first + opening, first + opening + uniform(0.7, 2.4)];
            BlurredJunction::y_or_arrow(vertex, edges, levels, uniform(0.4, 1.5))
        })
        .collect();
    let noise: Vec<f64> = (0..COUNT[0] * COUNT[1] * SIDE_PX * SIDE_PX)
        .map(|_| (0..4).map(|_| uniform(-5.0, 5.0)).sum())
        .collect();
    let picture = Plane::from_fn(COUNT[0] * SIDE_PX, COUNT[1] * SIDE_PX, |x, y| {
        let junction = &junctions[y / SIDE_PX * COUNT[0] + x / SIDE_PX];
        let value = junction.over_pixel(x % SIDE_PX, y % SIDE_PX, 1.0);
        #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
        let sample = (value + noise[y * COUNT[0] * SIDE_PX + x]).round() as f32;
        sample.clamp(0.0, 255.0)
    });
    let at = |n: usize, vertex: ImagePoint| {
        let [x, y] = [n % COUNT[0], n / COUNT[0]].map(|place| (place * SIDE_PX) as f64);
        ImagePoint::new(x + vertex.x, y + vertex.y)
    };
    let vertices = junctions.iter().enumerate().map(|(n, junction)| at(n, junction.vertex));
    (picture, vertices.collect())
}

/// What OpenCV says of a half window.
#[derive(serde::Deserialize)]
struct RefinedByOpenCv {
    points: Vec<[f64; 2]>,
}

/// On 10,000 seeds in a rendered photograph (a plant before the target, seen from above), texture, noise
/// and drawn junctions our `corner_sub_pix` and `cv2.cornerSubPix` agree to 1e-4 px, wherever both answer
/// and the way there keeps the window inside: at the right border OpenCV's resampling does not continue
/// the border's pixels as it says. They decline the same seeds.
#[test]
fn corner_sub_pix_equals_opencv_on_ten_thousand_seeds() {
    const SEEDS: usize = 2500;
    let mut random = TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]);
    let rendered = image::open(project().join("tests/fixtures/overhead-leaves.png"))
        .expect("a picture")
        .to_rgb8();
    let rendered = Exposure::from_picture(&rendered).luma().clone();
    let (junctions, vertices) = noisy_junctions(&mut random);
    let texture = Plane::from_fn(300, 200, crate::drawn::texture);
    let kernel = [1.0, 2.0, 1.0];
    let smooth = Plane::from_fn(300, 200, |x, y| {
        let sum: f32 = (0..9)
            .map(|k| {
                kernel[k % 3]
                    * kernel[k / 3]
                    * texture
                        .at_replicated((x + k % 3).cast_signed() - 1, (y + k / 3).cast_signed() - 1)
            })
            .sum();
        (sum / 16.0).round()
    });
    let nowhere = Vec::new();
    for (name, picture, places) in [
        ("rendered", &rendered, &nowhere),
        ("junctions", &junctions, &vertices),
        ("texture", &smooth, &nowhere),
        ("noise", &texture, &nowhere),
    ] {
        let size = [picture.width(), picture.height()];
        let seeds: Vec<Detection> = (0..SEEDS)
            .map(|n| {
                let mut coordinate = |axis: usize| {
                    let share = f64::from(random.next_u32()) / 4_294_967_296.0;
                    let place = match places.get(n % places.len().max(1)) {
                        Some(vertex) => [vertex.x, vertex.y][axis] + 5.0 * (share - 0.5),
                        None => (size[axis] - 1) as f64 * share,
                    };
                    // Float32 numbers, which is what OpenCV takes.
                    #[allow(clippy::cast_possible_truncation, reason = "on purpose")]
                    let place = place as f32;
                    f64::from(place)
                };
                crate::drawn::seed(coordinate(0), coordinate(1))
            })
            .collect();
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [file, points] = ["luma.png", "points.f32"].map(|name| folder.path().join(name));
        save_grey(picture, &file);
        #[allow(clippy::cast_possible_truncation, reason = "they are float32 numbers")]
        let bytes: Vec<u8> = seeds
            .iter()
            .flat_map(|seed| [seed.point.x as f32, seed.point.y as f32])
            .flat_map(f32::to_le_bytes)
            .collect();
        fs::write(&points, bytes).expect("written");
        let half_windows: [u8; 4] = [3, 5, 7, 10];
        let said = succeed(
            Command::new(python())
                .arg(project().join("scripts/tests/peers/opencv_corner_sub_pix.py"))
                .args([&file, &points])
                .arg("1")
                .args(half_windows.map(|half_window| half_window.to_string())),
        );
        let mut said: serde_json::Value = serde_json::from_str(&said).expect("JSON");
        let exposure = crate::drawn::grey(picture.clone());
        for half_window_px in half_windows {
            let theirs = said["windows"][half_window_px.to_string()].take();
            let theirs: RefinedByOpenCv = serde_json::from_value(theirs).expect("points");
            let refiner =
                CornerSubPix { half_window_px, least_roundness: 0.0, ..CornerSubPix::default() };
            let ours = refiner.refine(&exposure, &seeds);
            assert_eq!((ours.len(), theirs.points.len()), (SEEDS, SEEDS));
            let mut compared = 0;
            for (ours, theirs) in ours.iter().zip(theirs.points.into_iter().map(ImagePoint::from)) {
                // The window about an answer, which is at most w from the seed.
                let margin = 2.0 * f64::from(half_window_px) + 2.0;
                let is_inside = [(ours.seed.point.x, size[0]), (ours.seed.point.y, size[1])]
                    .iter()
                    .all(|(place, count)| (margin..*count as f64 - margin).contains(place));
                let declined = theirs == ours.seed.point;
                if !is_inside || (declined && ours.position == theirs) {
                    continue;
                }
                let distance_px = ours.position.distance_px(theirs);
                let place = format!("{name}, w {half_window_px}");
                assert!(distance_px < 1e-4, "{place}: {ours:?}, OpenCV has {theirs:?}");
                compared += 1;
            }
            assert!(compared > SEEDS / 5, "{name}, w {half_window_px}: {compared}");
        }
    }
}

/// Writes whole numbers below 256 as a grey picture.
fn save_grey(plane: &Plane<f32>, file: &Path) {
    let [width, height] =
        [plane.width(), plane.height()].map(|size| u32::try_from(size).expect("some hundreds"));
    let grey = image::GrayImage::from_fn(width, height, |x, y| {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole")]
        let value = plane.at(x as usize, y as usize) as u8;
        image::Luma([value])
    });
    grey.save(file).expect("written");
}

/// OpenCV's form of the structure tensor's measures, of a plane.
fn as_opencv(plane: &Plane<f32>, measure: &impl Measure) -> Plane<f32> {
    let tensor = StructureTensor {
        derivative: Derivative::Sobel,
        window: Window::Box,
        border: Border::Reflect,
        ..StructureTensor::default()
    };
    let mut response = Plane::filled(plane.width(), plane.height(), f32::NAN);
    let buffers = &mut TensorBuffers::default();
    tensor.kernels().response(&[(plane.view(), 1.0)], buffers, measure, &mut response);
    response
}

/// On a rendered photograph, on texture and on noise, to the border: the responses to 1e-5 of the
/// largest, the points of `goodFeaturesToTrack` in their order.
#[test]
fn detectors_equal_opencv() {
    let rendered = image::open(project().join("tests/fixtures/overhead-leaves.png"))
        .expect("a picture")
        .to_rgb8();
    let mut random = TestRng::from_seed(RngAlgorithm::ChaCha, &[9; 32]);
    let noise = image::RgbImage::from_fn(133, 71, |_, _| {
        #[allow(clippy::cast_possible_truncation, reason = "any byte")]
        let value = random.next_u32() as u8;
        image::Rgb([value; 3])
    });
    let texture = image::RgbImage::from_fn(200, 160, |x, y| {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a grey value")]
        let value = crate::drawn::texture(x as usize, y as usize).clamp(0.0, 255.0) as u8;
        image::Rgb([value; 3])
    });
    // The strongest response is on the image's border: it counts for the threshold, but is no corner.
    let mut border = image::RgbImage::from_fn(200, 160, |x, y| {
        image::Rgb(texture.get_pixel(x, y).0.map(|value| value / 8))
    });
    border.put_pixel(0, 40, image::Rgb([255; 3]));
    for (name, picture) in
        [("rendered", rendered), ("noise", noise), ("texture", texture), ("border", border)]
    {
        let exposure = Exposure::from_picture(&picture);
        let luma = exposure.luma();
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("luma.png");
        save_grey(luma, &file);
        let said = succeed(
            Command::new(python())
                .arg(project().join("scripts/tests/peers/detectors.py"))
                .arg("opencv")
                .args([&file, folder.path()])
                .arg("1"),
        );
        let theirs = |response: &str| -> Vec<f32> {
            fs::read(folder.path().join(format!("{response}.f32")))
                .expect("a response")
                .chunks_exact(4)
                .map(|four| f32::from_le_bytes(four.try_into().expect("four bytes")))
                .collect()
        };
        let harris = as_opencv(luma, &Harris::default());
        let eigenvalue = as_opencv(luma, &ShiTomasi::default());
        for (kind, ours) in
            [("harris", &harris), ("harris_float", &harris), ("min_eigenvalue", &eigenvalue)]
        {
            let theirs = theirs(kind);
            let largest = theirs.iter().fold(0.0, |most: f32, value| most.max(value.abs()));
            let far = ours
                .samples()
                .iter()
                .zip(&theirs)
                .map(|(ours, theirs)| (ours - theirs).abs() / largest)
                .fold(0.0, f32::max);
            assert!(far < 1e-5, "{name}: {kind} differs by {far} of the largest");
        }
        let said: serde_json::Value = serde_json::from_str(&said).expect("JSON");
        let theirs: Vec<[f64; 2]> =
            serde_json::from_value(said["points"]["good_features"].clone()).expect("points");
        let ours: Vec<[f64; 2]> = GoodFeatures::default()
            .detect(&exposure, None)
            .iter()
            .map(|found| found.point.into())
            .collect();
        assert!(theirs.len() > 20, "{name}: {}", theirs.len());
        assert_eq!(ours.len(), theirs.len(), "{name}");
        let is_other = |(ours, theirs): &(&[f64; 2], &[f64; 2])| {
            (ours[0] - theirs[0]).abs() + (ours[1] - theirs[1]).abs() > 0.0
        };
        let moved = ours.iter().zip(&theirs).filter(is_other).count();
        assert_eq!(moved, 0, "{name}: {moved} of {} points are others", theirs.len());

        let mut theirs: Vec<[f64; 3]> =
            serde_json::from_value(said["points"]["fast"].clone()).expect("corners");
        // OpenCV's score of whole numbers is less by one.
        let mut ours: Vec<[f64; 3]> = Fast::default()
            .detect(&exposure, None)
            .iter()
            .map(|found| [found.point.x, found.point.y, found.response - 1.0])
            .collect();
        for corners in [&mut ours, &mut theirs] {
            corners.sort_by(|a, b| a[1].total_cmp(&b[1]).then(a[0].total_cmp(&b[0])));
        }
        assert!(theirs.len() > 20 || name == "border", "{name}: {}", theirs.len());
        assert_eq!(ours, theirs, "{name}");
    }
}
