//! `cornerbench locate` on pictures of one's own: every kind of file, known corners, what is wrong with either.

#![allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "samples in range")]

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use cornerbench::image::Plane;
use cornerbench::junction::drawing::{Drawing, DrawingBuffers};
use cornerbench::junction::rays::Rays;
use cornerbench::sensor::Transfer;
use image::{ImageBuffer, Luma, Rgb};
use serde_json::Value;

use crate::support::{cornerbench, run, stderr, succeed};

const SIZE: usize = 48;
/// So many pictures are in a folder.
pub const COUNT: usize = 6;

/// Where the corner of a picture is.
fn vertex(index: usize) -> [f64; 2] {
    let index = index as f64;
    [23.0 + (0.37 * index).fract(), 22.6 + (0.53 * index).fract()]
}

/// Light from 0 to 1: an L corner of little contrast, so that eight bits are few.
fn light(index: usize) -> Plane<f32> {
    let first = 0.3 + 0.8 * index as f64;
    let angles_rad = [first, first + 1.6, 0.0];
    let rays = Rays { vertex: vertex(index), sigma_px: 0.8, count: 2, angles_rad };
    let drawing = Drawing { rays, levels: [0.45, 0.35, 0.0], ramps: [[0.0; 2]; 3] };
    drawing.over_pixels([SIZE, SIZE], &mut DrawingBuffers::default())
}

/// The samples of a picture, of a curve and a number for full scale.
fn encoded(light: &Plane<f32>, transfer: Transfer, full: f64) -> Vec<f64> {
    light
        .samples()
        .iter()
        .map(|light| (transfer.encode(f64::from(*light)) * full).round())
        .collect()
}

/// Writes a picture as the kind of file that `kind` names.
fn save(path: &Path, kind: &str, light: &Plane<f32>) {
    let size = SIZE as u32;
    let eight: Vec<u8> =
        encoded(light, Transfer::Srgb, 255.0).into_iter().map(|sample| sample as u8).collect();
    let sixteen: Vec<u16> =
        encoded(light, Transfer::Srgb, 65535.0).into_iter().map(|sample| sample as u16).collect();
    match kind {
        "8.png" | "8.bmp" => ImageBuffer::<Luma<u8>, _>::from_raw(size, size, eight)
            .expect("a picture")
            .save(path)
            .expect("saved"),
        "16.png" | "16.tif" => ImageBuffer::<Luma<u16>, _>::from_raw(size, size, sixteen)
            .expect("a picture")
            .save(path)
            .expect("saved"),
        "colour16.png" | "colour16.tif" => {
            let samples = sixteen.into_iter().flat_map(|sample| [sample; 3]).collect();
            ImageBuffer::<Rgb<u16>, Vec<u16>>::from_raw(size, size, samples)
                .expect("a picture")
                .save(path)
                .expect("saved");
        }
        "8.jpg" => {
            let file = fs::File::create(path).expect("created");
            image::codecs::jpeg::JpegEncoder::new_with_quality(file, 100)
                .encode(&eight, size, size, image::ExtendedColorType::L8)
                .expect("encoded");
        }
        "float.tif" => {
            let file = fs::File::create(path).expect("created");
            tiff::encoder::TiffEncoder::new(file)
                .expect("an encoder")
                .write_image::<tiff::encoder::colortype::Gray32Float>(size, size, light.samples())
                .expect("written");
        }
        "colour.exr" => exr::prelude::write_rgb_file(path, SIZE, SIZE, |x, y| {
            // Radiance has no full scale.
            let light = 5.0 * light.at(x, y);
            (light, light, light)
        })
        .expect("written"),
        other => panic!("no kind {other}"),
    }
}

/// A folder of pictures with known corners in known.csv and known.json, counted from an offset.
pub fn folder(kind: &str, offset_px: f64) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let (mut csv, mut json) = ("y_px,image,name,x_px\n".to_owned(), serde_json::Map::new());
    for index in 0..COUNT {
        let name = format!("{index}-{kind}");
        save(&folder.path().join(&name), kind, &light(index));
        let [x, y] = vertex(index).map(|at| at + offset_px);
        writeln!(csv, "{y},{name},\"corner, {index}\",{x}").expect("text");
        json.insert(name, serde_json::json!([[x, y]]));
    }
    fs::write(folder.path().join("known.csv"), csv).expect("written");
    fs::write(folder.path().join("known.json"), Value::Object(json).to_string()).expect("written");
    folder
}

/// The lines of JSON of a folder with known corners, and the last one, which is the summary.
fn located(folder: &Path, known: &str, more: &[&str]) -> (Vec<Value>, Value) {
    let mut command = cornerbench();
    command
        .arg("locate")
        .arg(folder)
        .arg("--known")
        .arg(folder.join(known))
        .arg("--json")
        .args(more);
    let text = succeed(&mut command);
    let mut lines: Vec<Value> =
        text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let last = lines.pop().expect("a summary");
    (lines, last)
}

fn rms_error_px(summary: &Value) -> f64 {
    summary["scores"][0]["score"]["error"]["rms_px"].as_f64().expect("answers")
}

const FIT: [&str; 2] = ["--refiner", "junction_fit"];

#[test]
fn every_kind_of_file_is_read_without_loss() {
    let rms_px = |kind: &str| {
        let folder = folder(kind, 0.0);
        let (lines, summary) = located(folder.path(), "known.csv", &FIT);
        assert_eq!(lines.len(), COUNT, "{kind}");
        assert_eq!(summary["scores"][0]["score"]["answered"], COUNT, "{kind}: {summary}");
        rms_error_px(&summary)
    };
    let eight_px = rms_px("8.png");
    assert!(eight_px < 0.1, "{eight_px}");
    for kind in ["8.bmp", "8.jpg"] {
        assert!(rms_px(kind) < 0.2, "{kind}: {}", rms_px(kind));
    }
    for kind in ["16.png", "16.tif", "colour16.png", "colour16.tif", "float.tif", "colour.exr"] {
        let found_px = rms_px(kind);
        assert!(found_px < 0.5 * eight_px, "{kind}: {found_px}, 8 bits: {eight_px}");
    }
}

#[test]
fn csv_and_json_of_known_corners_say_the_same() {
    let folder = folder("16.png", 0.0);
    let (lines, of_csv) = located(folder.path(), "known.csv", &FIT);
    let (_, of_json) = located(folder.path(), "known.json", &FIT);
    let [of_csv_px, of_json_px] = [&of_csv, &of_json].map(rms_error_px);
    assert!((of_csv_px / of_json_px - 1.0).abs() < 1e-6, "{of_csv_px} {of_json_px}");
    assert_eq!(of_csv["likely_origin"], Value::Null);
    for (index, line) in lines.iter().enumerate() {
        assert!(line["image"].as_str().expect("a path").ends_with(&format!("{index}-16.png")));
        assert_eq!(line["label"], format!("corner, {index}"));
        assert_eq!(line["refiner"], "junction_fit");
        assert_eq!(line["status"], "ok");
        let covariance = line["covariance_px2"][0][0].as_f64().expect("a covariance");
        assert!(covariance > 0.0, "{line}");
    }
}

#[test]
fn corners_counted_from_the_pixels_corner_are_recognised() {
    for (offset_px, origin) in [(0.5, "pixel-corner"), (1.0, "matlab")] {
        let folder = folder("16.png", offset_px);
        let (_, summary) = located(folder.path(), "known.csv", &FIT);
        assert_eq!(summary["likely_origin"], origin);
        let known = folder.path().join("known.csv");
        let mut command = cornerbench();
        command.arg("locate").arg(folder.path()).arg("--known").arg(&known).args(FIT);
        let text = succeed(&mut command);
        assert!(text.contains(&format!("try --origin {origin}")), "{text}");
        let (_, summary) =
            located(folder.path(), "known.csv", &[&FIT[..], &["--origin", origin]].concat());
        assert_eq!(summary["likely_origin"], Value::Null);
        assert!(rms_error_px(&summary) < 0.01, "{summary}");
    }
}

#[test]
fn refiners_stand_side_by_side_and_agreement_is_not_accuracy() {
    let folder = folder("16.png", 0.0);
    let table = folder.path().join("located.csv");
    let mut command = cornerbench();
    command.arg("locate").arg(folder.path()).args(["--at", "23,23", "--refiner"]);
    command.arg("junction_fit,edge_intersection,none").arg("-o").arg(&table);
    let text = succeed(&mut command);
    for word in
        ["junction_fit", "edge_intersection", "none", "5-16.png", "Agreement is not accuracy"]
    {
        assert!(text.contains(word), "{word}: {text}");
    }
    let mut reader = csv::Reader::from_path(&table).expect("a table");
    let header = reader.headers().expect("a header").clone();
    assert_eq!(header.iter().take(2).collect::<Vec<_>>(), ["image", "refiner"]);
    assert_eq!(reader.records().filter_map(Result::ok).count(), 3 * COUNT);
    let again = succeed(&mut command);
    assert_eq!(text, again, "the order is always the same");
}

#[test]
fn every_refiner_can_be_asked_at_once() {
    let folder = folder("8.png", 0.0);
    let (lines, summary) = located(folder.path(), "known.csv", &["--refiner", "all"]);
    let names = cornerbench::refine::REFINERS.len();
    assert_eq!(lines.len(), COUNT * names);
    assert_eq!(summary["scores"].as_array().expect("scores").len(), names);
}

#[test]
fn a_detector_finds_known_corners_by_itself() {
    let folder = folder("16.png", 0.0);
    let more = [&FIT[..], &["--detector", "harris"]].concat();
    let (_, summary) = located(folder.path(), "known.csv", &more);
    let answered = summary["scores"][0]["score"]["answered"].as_u64().expect("a number");
    assert!(answered >= COUNT as u64 - 1, "{summary}");
}

#[test]
fn a_camera_makes_covariances_mean_something() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("twelve.png");
    // Black is 40, of an industrial camera without a mosaic.
    let samples = encoded(&light(0), Transfer::Linear, 4055.0);
    let samples: Vec<u16> = samples.into_iter().map(|sample| sample as u16 + 40).collect();
    let save = |samples: Vec<u16>| {
        let picture = ImageBuffer::<Luma<u16>, _>::from_raw(SIZE as u32, SIZE as u32, samples);
        picture.expect("a picture").save(&path).expect("saved");
    };
    let variance_px2 = |more: &[&str]| {
        let mut command = cornerbench();
        command.arg("locate").arg(&path).args(["--at", "23.5,23", "--json"]).args(FIT).args(more);
        let line: Value = serde_json::from_str(succeed(&mut command).trim()).expect("JSON");
        assert_eq!(line["status"], "ok", "{line}");
        line["covariance_px2"][0][0].as_f64().expect("a covariance")
    };
    save(samples.clone());
    let of_rounding = variance_px2(&["--transfer", "linear"]);
    let of_camera = variance_px2(&["--camera", "industrial-mono"]);
    assert!(of_camera > 10.0 * of_rounding, "{of_camera} {of_rounding}");
    // The same numbers at the upper end of sixteen bits.
    save(samples.iter().map(|sample| sample << 4).collect());
    let shifted = variance_px2(&["--camera", "industrial-mono"]);
    assert!((shifted / of_camera - 1.0).abs() < 1e-9, "{shifted} {of_camera}");

    save(samples.iter().map(|sample| (sample << 4) | 1).collect());
    fails(
        &[path.as_ref(), "--camera".as_ref(), "industrial-mono".as_ref()],
        &["camera industrial-mono gives 12 bits"],
    );
}

/// Runs `cornerbench locate` with arguments that make it fail, and looks for words in what it says.
#[track_caller]
fn fails(arguments: &[&std::ffi::OsStr], words: &[&str]) {
    let output = run(cornerbench().arg("locate").args(arguments));
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    for word in words {
        assert!(text.contains(word), "{word:?} is not in: {text}");
    }
}

#[test]
fn what_is_wrong_is_named_with_the_next_step() {
    let folder = folder("8.png", 0.0);
    let path = |name: &str| folder.path().join(name);
    let known = path("wrong.csv");
    let with_known = |text: &str, words: &[&str]| {
        fs::write(&known, text).expect("written");
        fails(&[folder.path().as_ref(), "--known".as_ref(), known.as_ref()], words);
    };
    with_known(
        "image,x_px,y_px\n0-8.pgn,1,2\n",
        &["wrong.csv: line 2: unknown image \"0-8.pgn\"; did you mean \"0-8.png\"?"],
    );
    with_known(
        "image,x_px,y_px\n0-8.png,nan,2\n",
        &["line 2: x_px is \"nan\", must be a finite number"],
    );
    with_known("image,x_px\n", &["line 1: column y_px is missing"]);
    with_known("image;x_px;y_px\n", &["unknown column", "known: image, x_px, y_px"]);

    let picture = path("0-8.png");
    fs::write(&known, "image,x_px,y_px\n0-8.png,400,2\n").expect("written");
    let words = ["line 2: x_px is 400, must be in [-0.5, 47.5]", "48 x 48 px"];
    fails(&[picture.as_ref(), "--known".as_ref(), known.as_ref()], &words);
    // A file that names other pictures of the folder is no mistake.
    let mut command = cornerbench();
    command.arg("locate").arg(&picture).arg("--known").arg(path("known.csv")).args(FIT);
    assert!(succeed(&mut command).contains("1 of 1"));

    let with = |option: &str, value: &str, words: &[&str]| {
        fails(&[picture.as_ref(), option.as_ref(), value.as_ref()], words);
    };
    with("--known", "Cargo.toml", &["ends in .toml, must end in .csv or .json"]);
    with(
        "--refiner",
        "junction_fti",
        &["unknown refiner \"junction_fti\"; did you mean \"junction_fit\"?"],
    );
    with("--detector", "haris", &["unknown detector \"haris\"; did you mean \"harris\"?"]);
    with("--camera", "industrial-mno", &["unknown camera", "did you mean \"industrial-mono\"?"]);
    with(
        "--camera",
        "industrial-mono",
        &["its samples have 8 bits, camera industrial-mono gives 12 bits"],
    );
    with("--transfer", "gamma9", &["linear, srgb, or gamma and a number in [1, 4]"]);
    with("--white", "0", &["--white is 0, must be in (0"]);

    let empty = tempfile::tempdir().expect("a folder");
    fails(&[empty.path().as_ref()], &["no picture is here", ".png"]);
    fs::write(path("none.png"), "text").expect("written");
    fails(
        &[path("none.png").as_ref()],
        &["none.png: is no picture", "PNG, JPEG, TIFF, BMP or OpenEXR"],
    );
    fs::write(path("cut.png"), &fs::read(&picture).expect("a file")[..60]).expect("written");
    fails(&[path("cut.png").as_ref()], &["cut.png"]);
    fails(&[path("missing.png").as_ref()], &["missing.png: cannot read"]);
}

#[test]
fn one_picture_that_cannot_be_read_does_not_stop_the_others() {
    let folder = folder("8.png", 0.0);
    fs::write(folder.path().join("broken.png"), "text").expect("written");
    let output = run(cornerbench().arg("locate").arg(folder.path()).args(["--at", "23,23"]));
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("skipped:") && stderr(&output).contains("broken.png"));
}

#[test]
fn more_pixels_than_are_allowed_are_refused_before_they_are_decoded() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("large.bmp");
    // The header of a bitmap of 40000 x 40000 px of 24 bits, and nothing else.
    let mut header = b"BM".to_vec();
    for number in [54_u32, 0, 54, 40, 40000, 40000, 1 | (24 << 16), 0, 0, 0, 0, 0, 0] {
        header.extend(number.to_le_bytes());
    }
    fs::write(&path, header).expect("written");
    fails(&[path.as_ref()], &["large.bmp: is 40000 x 40000 px, must have 1 to 268435456 px"]);
}

#[test]
fn a_picture_is_turned_as_its_exif_says() {
    let folder = folder("8.jpg", 0.0);
    let path = folder.path().join("0-8.jpg");
    let locate = |at: &str| {
        let mut command = cornerbench();
        command.arg("locate").arg(&path).args(["--at", at, "--json"]).args(FIT);
        let line: Value = serde_json::from_str(succeed(&mut command).trim()).expect("JSON");
        [0, 1].map(|axis| line["position_px"][axis].as_f64().expect("a number"))
    };
    let [x, y] = locate("23,22.6");
    // A segment of EXIF behind the first marker, with orientation 6: to be shown turned to the right.
    let mut exif = b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0".to_vec();
    exif.extend(b"\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0");
    let mut bytes = fs::read(&path).expect("a file");
    bytes.splice(2..2, exif);
    fs::write(&path, bytes).expect("written");
    let last = SIZE as f64 - 1.0;
    let [turned_x, turned_y] = locate("24.4,23");
    assert!((turned_x - (last - y)).hypot(turned_y - x) < 1e-3, "{x} {y}: {turned_x} {turned_y}");
    fails(&[path.as_ref(), "--camera".as_ref(), "webcam".as_ref()], &["EXIF orientation turns it"]);
}
