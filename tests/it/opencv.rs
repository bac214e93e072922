//! Our answers beside OpenCV's, on the same picture and seeds.

use std::fmt::Write as _;
use std::fs;
use std::process::Command;

use proptest::prelude::Rng;
use proptest::test_runner::{RngAlgorithm, TestRng};

use cornerbench::detect::Detector;
use cornerbench::detect::fast::Fast;
use cornerbench::detect::good_features::GoodFeatures;
use cornerbench::detect::harris::Harris;
use cornerbench::detect::shi_tomasi::ShiTomasi;
use cornerbench::detect::tensor::{Derivative, Measure, StructureTensor, TensorBuffers, Window};
use cornerbench::filter::Border;
use cornerbench::image::Plane;
use cornerbench::sensor::Exposure;

use crate::support::{cornerbench, project, python, succeed};

const SEEDS: usize = 1000;

/// On 1,000 random seeds over a rendered photograph our `corner_sub_pix` and `cv2.cornerSubPix` agree
/// to 1e-3 px on at least 99 %. What differs has been at the right border, where OpenCV's resampling
/// does not replicate the border's pixels as it says. The picture is the exposure of a rendered scene
/// (a plant before the target, seen from above).
#[test]
fn corner_sub_pix_equals_opencv_over_a_rendered_picture() {
    let picture = project().join("tests/fixtures/overhead-leaves.png");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let points = folder.path().join("points.csv");
    let mut random = TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]);
    let mut text = String::new();
    for _ in 0..SEEDS {
        let mut coordinate = || f64::from(random.next_u32()) / 4_294_967_296.0 * 511.0;
        // Float32 numbers, which is what OpenCV takes.
        #[allow(clippy::cast_possible_truncation, reason = "on purpose")]
        let (x, y) = (coordinate() as f32, coordinate() as f32);
        let _ = writeln!(text, "{},{}", f64::from(x), f64::from(y));
    }
    fs::write(&points, text).expect("written");

    let ours = succeed(
        cornerbench().arg("locate").arg(&picture).arg("--points").arg(&points).arg("--json"),
    );
    let theirs = succeed(
        Command::new(python())
            .arg(project().join("scripts/tests/peers/opencv_corner_sub_pix.py"))
            .arg(&picture)
            .arg(&points),
    );
    let mut far = Vec::new();
    for (ours, theirs) in ours.lines().zip(theirs.lines()) {
        let ours: serde_json::Value = serde_json::from_str(ours).expect("JSON");
        let theirs: [f64; 2] = serde_json::from_str(theirs).expect("JSON");
        let [x, y] = [0, 1].map(|axis| ours["position_px"][axis].as_f64().expect("a number"));
        let distance_px = (x - theirs[0]).hypot(y - theirs[1]);
        if distance_px > 1e-3 {
            far.push(format!("{ours}: OpenCV at {theirs:?}, {distance_px} px away"));
        }
    }
    assert_eq!(theirs.lines().count(), SEEDS);
    assert!(far.len() <= SEEDS / 100, "{} of {SEEDS} differ:\n{}", far.len(), far.join("\n"));
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
        let grey = image::GrayImage::from_fn(picture.width(), picture.height(), |x, y| {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole")]
            let value = luma.at(x as usize, y as usize) as u8;
            image::Luma([value])
        });
        grey.save(&file).expect("written");
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
