//! Corner refinement.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use comfy_table::{Table, presets};
use cornerbench::detect::Detection;
use cornerbench::geometry::ImagePoint;
use cornerbench::image::Plane;
use cornerbench::junction::drawing::{Drawing, DrawingBuffers};
use cornerbench::junction::rays::Rays;
use cornerbench::refine::annular_orthogonality::AnnularOrthogonality;
use cornerbench::refine::corner_sub_pix::CornerSubPix;
use cornerbench::refine::junction_fit::JunctionFit;
use cornerbench::refine::{REFINERS, Refiner};
use cornerbench::sensor::{Encoding, Exposure, Transfer};
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
    drawn(c);
    if crate::asked("refine/peers") {
        compare();
        compare_drawn();
    }
}

/// Junctions side by side in one picture, 8 bits, and seeds within a pixel of their vertices.
struct Grid {
    exposure: Exposure,
    seeds: Vec<[f32; 2]>,
}

impl Grid {
    const TILE: usize = 48;
    const TILES: [usize; 2] = [20, 12];

    /// Of Ls of 60 to 150 degrees, or of Ys.
    fn new(kind: &str) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let mut uniform = || f64::from(random.next_u32()) / 4_294_967_296.0;
        let [columns, rows] = Self::TILES;
        let mut plane = Plane::filled(columns * Self::TILE, rows * Self::TILE, 0.0);
        let mut buffers = DrawingBuffers::default();
        let mut seeds = Vec::new();
        for tile in 0..columns * rows {
            let (left, top) = (tile % columns * Self::TILE, tile / columns * Self::TILE);
            let vertex = [23.0 + uniform(), 23.0 + uniform()];
            let turn = std::f64::consts::TAU * uniform();
            let opening = (60.0 + 90.0 * uniform()).to_radians();
            let third = std::f64::consts::TAU / 3.0;
            let (count, second, levels) = match kind {
                "L" => (2, opening, [0.8, 0.2, 0.0]),
                _ => (3, third, [0.8, 0.5, 0.3]),
            };
            let angles_rad = [turn, turn + second, turn + 2.0 * third];
            let rays = Rays { vertex, sigma_px: 0.5 + uniform(), count, angles_rad };
            let drawing = Drawing { rays, levels, ramps: [[0.0; 2]; 3] };
            let picture = drawing.over_pixels([Self::TILE; 2], &mut buffers);
            for y in 0..Self::TILE {
                let row = &mut plane.row_mut(top + y)[left..left + Self::TILE];
                row.iter_mut()
                    .zip(picture.row(y))
                    .for_each(|(to, from)| *to = (255.0 * from).round());
            }
            let (far, direction) = (uniform().sqrt(), std::f64::consts::TAU * uniform());
            #[allow(clippy::cast_possible_truncation, reason = "OpenCV takes float32")]
            seeds.push([
                (left as f64 + vertex[0] + far * direction.cos()) as f32,
                (top as f64 + vertex[1] + far * direction.sin()) as f32,
            ]);
        }
        let encoding = Encoding { bit_depth: 8, transfer: Transfer::Linear, black_dn: 0.0 };
        let exposure = Exposure::new([plane.clone(), plane.clone(), plane], encoding);
        Self { exposure: exposure.expect("finite"), seeds }
    }

    fn detections(&self) -> Vec<Detection> {
        let of = |&[x, y]: &[f32; 2]| ImagePoint::new(f64::from(x), f64::from(y));
        self.seeds.iter().map(|seed| Detection::new(of(seed), 1.0)).collect()
    }
}

/// Every refiner on drawn junctions.
fn drawn(c: &mut Criterion) {
    for kind in ["L", "Y"] {
        let grid = Grid::new(kind);
        grid.exposure.luma();
        let detections = grid.detections();
        let mut group = c.benchmark_group(format!("refine/drawn {kind}"));
        group.throughput(Throughput::Elements(detections.len() as u64));
        for entry in REFINERS.iter().filter(|entry| entry.name != "none") {
            let refiner = (entry.build)(entry.name, &toml::Table::new()).expect("its defaults");
            group.bench_function(entry.name, |b| {
                b.iter(|| refiner.refine(&grid.exposure, &detections));
            });
        }
        group.finish();
    }
}

/// Prints how long our refiners take for a corner beside `cv2.cornerSubPix`: the same pictures of drawn junctions
/// and seeds, one core, in turns.
fn compare_drawn() {
    const ROUNDS: usize = 7;
    const REPEATS: usize = 5;
    let Some(python) = python() else { return };
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header([
        "junctions",
        "refiner",
        "us a corner",
        "OpenCV's half window px",
        "us a corner",
        "ours / OpenCV's",
    ]);
    let one = pool(1);
    for kind in ["L", "Y"] {
        let grid = Grid::new(kind);
        grid.exposure.luma();
        let detections = grid.detections();
        let folder = tempfile::tempdir().expect("a folder");
        let files = written(folder.path(), &grid.exposure, &grid.seeds);
        let ours: [(&str, u8, Box<dyn Refiner>); 2] = [
            ("annular_orthogonality", 5, Box::new(AnnularOrthogonality::default())),
            ("junction_fit", 10, Box::new(JunctionFit::default())),
        ];
        let mut times: Vec<Vec<[f64; 2]>> = vec![Vec::new(); ours.len()];
        for _ in 0..ROUNDS {
            let said = ask(&python, &files, REPEATS, &[5, 10]);
            for ((_, half_window_px, refiner), times) in ours.iter().zip(&mut times) {
                let mut corners = refiner.refine(&grid.exposure, &detections);
                let took = one.install(|| {
                    Times::of(REPEATS, || corners = refiner.refine(&grid.exposure, &detections))
                });
                let us = |took_s: f64| 1e6 * took_s / detections.len() as f64;
                let theirs = said.windows[half_window_px].took_s.median;
                times.push([us(took.median_s), us(theirs)]);
            }
        }
        for ((name, half_window_px, _), rounds) in ours.iter().zip(&times) {
            let of = |value: fn(&[f64; 2]) -> f64| Spread::of(rounds.iter().map(value).collect());
            table.add_row([
                kind.to_owned(),
                (*name).to_owned(),
                format!("{:.1}", of(|[ours, _]| *ours)),
                half_window_px.to_string(),
                format!("{:.1}", of(|[_, theirs]| *theirs)),
                format!("{:.2}", of(|[ours, theirs]| ours / theirs)),
            ]);
        }
    }
    println!("{table}");
}

/// A picture and points as files that OpenCV's script reads.
fn written(folder: &Path, exposure: &Exposure, seeds: &[[f32; 2]]) -> [PathBuf; 2] {
    let [picture, points] = ["luma.png", "points.f32"].map(|name| folder.join(name));
    exposure.to_picture().save(&picture).expect("written");
    let bytes: Vec<u8> = seeds.iter().flatten().flat_map(|place| place.to_le_bytes()).collect();
    std::fs::write(&points, bytes).expect("written");
    [picture, points]
}

/// What OpenCV makes of them.
fn ask(python: &Path, files: &[PathBuf; 2], repeats: usize, half_windows: &[u8]) -> Said {
    let output = Command::new(python)
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/tests/peers/opencv_corner_sub_pix.py"))
        .args(files)
        .arg(repeats.to_string())
        .args(half_windows.iter().map(u8::to_string))
        .output()
        .expect("Python");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
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
    let files = written(folder.path(), &exposure, &seeds);

    let one = pool(1);
    let mut version = String::new();
    let mut rounds: BTreeMap<u8, Vec<[f64; 2]>> = BTreeMap::new();
    let mut differing = BTreeMap::new();
    for _ in 0..ROUNDS {
        let said = ask(&python, &files, REPEATS, &HALF_WINDOWS);
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
