//! Corner refinement.

use std::collections::BTreeMap;
use std::process::Command;

use comfy_table::{Table, presets};
use cornerbench::detect::Detection;
use cornerbench::geometry::ImagePoint;
use cornerbench::refine::Refiner;
use cornerbench::refine::corner_sub_pix::CornerSubPix;
use criterion::{Criterion, Throughput};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use serde::Deserialize;

use super::peers::{TookS, python};
use super::photograph::{COUNT, FIRST, STEP, copy, photograph, texture};
use super::turns::{Spread, Times, pool};

/// Adds the stage's benchmarks.
pub fn define(c: &mut Criterion) {
    copy(c, "refine");
    let exposure = photograph();
    exposure.luma(); // computed once per exposure, not once per refinement
    // A pixel and a half from the corner, in eight directions by turns.
    let seeds: Vec<Detection> = (0..COUNT * COUNT)
        .map(|n| {
            let corner = |n: usize| (FIRST + n % COUNT * STEP) as f64 - 0.5;
            let (sin, cos) = (std::f64::consts::FRAC_PI_4 * n as f64).sin_cos();
            let point = ImagePoint::new(
                (corner(n) + 1.5 * cos).round(),
                (corner(n / COUNT) + 1.5 * sin).round(),
            );
            Detection::new(point, 1.0)
        })
        .collect();

    let mut group = c.benchmark_group("refine");
    group.throughput(Throughput::Elements(seeds.len() as u64));
    for half_window_px in [3, 5, 10] {
        let refiner = CornerSubPix { half_window_px, ..CornerSubPix::default() };
        let corners = refiner.refine(&exposure, &seeds);
        assert!(corners.iter().all(|corner| {
            let position = corner.position;
            let off = |x: f64| (x + 0.5 - FIRST as f64) / STEP as f64;
            [off(position.x), off(position.y)].iter().all(|n| (n - n.round()).abs() < 1e-3)
        }));
        group.bench_function(format!("corner_sub_pix/w{half_window_px}"), |b| {
            b.iter(|| refiner.refine(&exposure, &seeds));
        });
    }
    group.finish();
    if crate::asked("refine/peers") {
        compare();
    }
}

/// What OpenCV's script says.
#[derive(Deserialize)]
struct Said {
    version: String,
    windows: BTreeMap<u8, Refined>,
}

#[derive(Deserialize)]
struct Refined {
    points: Vec<[f64; 2]>,
    took_s: TookS,
}

/// Prints how long our `corner_sub_pix` and `cv2.cornerSubPix` take for a corner: the same picture and
/// seeds, one core, in turns.
///
/// # Panics
/// After that, when an answer differs by more than 1e-4 px.
fn compare() {
    const ROUNDS: usize = 7;
    const REPEATS: usize = 9;
    const HALF_WINDOWS: [u8; 4] = [3, 5, 7, 10];
    let Some(python) = python() else { return };
    let exposure = texture(640, 480);
    exposure.luma();
    // Within two pixels of where four squares meet, as f32 numbers, which is what OpenCV takes.
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut off = || (random.next_u32() % 1024) as f32 / 256.0 - 2.0;
    let seeds: Vec<[f32; 2]> = (2..38)
        .flat_map(|x| (2..28).map(move |y| [16.0 * x as f32 - 0.5, 16.0 * y as f32 - 0.5]))
        .map(|[x, y]| [x + off(), y + off()])
        .collect();
    let detections: Vec<Detection> = seeds
        .iter()
        .map(|&[x, y]| Detection::new(ImagePoint::new(f64::from(x), f64::from(y)), 1.0))
        .collect();
    let folder = tempfile::tempdir().expect("a folder");
    let [picture, points] = ["luma.png", "points.f32"].map(|name| folder.path().join(name));
    exposure.to_picture().save(&picture).expect("written");
    let bytes: Vec<u8> = seeds.iter().flatten().flat_map(|place| place.to_le_bytes()).collect();
    std::fs::write(&points, bytes).expect("written");

    let one = pool(1);
    let mut version = String::new();
    let mut rounds: BTreeMap<u8, Vec<[f64; 2]>> = BTreeMap::new();
    let mut differing = BTreeMap::new();
    for _ in 0..ROUNDS {
        let output = Command::new(&python)
            .arg(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/scripts/tests/peers/opencv_corner_sub_pix.py"
            ))
            .args([&picture, &points])
            .arg(REPEATS.to_string())
            .args(HALF_WINDOWS.map(|half_window| half_window.to_string()))
            .output()
            .expect("Python");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let said: Said = serde_json::from_slice(&output.stdout).expect("JSON");
        version = said.version;
        for (half_window_px, theirs) in said.windows {
            let refiner =
                CornerSubPix { half_window_px, least_roundness: 0.0, ..CornerSubPix::default() };
            let mut corners = refiner.refine(&exposure, &detections);
            let ours = one.install(|| {
                Times::of(REPEATS, || corners = refiner.refine(&exposure, &detections))
            });
            let us = |took_s: f64| 1e6 * took_s / seeds.len() as f64;
            let times = [us(ours.median_s), us(theirs.took_s.median)];
            rounds.entry(half_window_px).or_default().push(times);
            let far = corners.iter().zip(&theirs.points).filter(|(corner, theirs)| {
                corner.position.distance_px(ImagePoint::from(**theirs)) > 1e-4
            });
            differing.insert(half_window_px, far.count());
        }
    }
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header([
        "half window px",
        "ours us",
        "OpenCV us",
        "ratio",
        "differing",
    ]);
    for (half_window_px, rounds) in &rounds {
        let of = |value: fn(&[f64; 2]) -> f64| Spread::of(rounds.iter().map(value).collect());
        table.add_row([
            half_window_px.to_string(),
            format!("{:.2}", of(|[ours, _]| *ours)),
            format!("{:.1}", of(|[_, theirs]| *theirs)),
            format!("{:.1}", of(|[ours, theirs]| theirs / ours)),
            format!("{} of {}", differing[half_window_px], seeds.len()),
        ]);
    }
    println!("{table}");
    println!(
        "A corner's time beside OpenCV {version}, one core each, {ROUNDS} rounds in turns of {REPEATS} \
         calls: median of the rounds' medians (least to most), ratio of the medians."
    );
    assert!(differing.values().all(|&count| count == 0), "answers differ");
}
