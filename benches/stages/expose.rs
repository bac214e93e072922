//! Photographs: light on the pixels, electrons, encoding, and all of it.
//!
//! Where the peers' Python is (`peers.rs`), the version of the camera in NumPy
//! (`scripts/tests/peers/exposure_oracle.py`) is timed in the same run.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use cornerbench::geometry::{Camera, Pose};
use cornerbench::image::{PixelRange, Plane};
use cornerbench::scene::{Film, RangeRays};
use cornerbench::sensor::{
    CameraModel, Colour, Curve, Demosaic, GatherBuffers, PhotographBuffers, Photographer,
    RangeSensor, Sensor, Shot,
};
use criterion::{Criterion, Throughput};
use rayon::prelude::*;

use super::peers::python;
use super::photograph::SIZE;
use super::turns::{Spread, Times, speed_up};

const OVERSAMPLING: u32 = 4;

fn film() -> Film {
    let side = SIZE * OVERSAMPLING as usize;
    let plane = |step: usize| {
        Plane::from_fn(side, side, |x, y| {
            ((x / 40 * step + y / 50 * 7 + x * y % 5) % 64) as f32 / 80.0
        })
    };
    Film { oversampling: OVERSAMPLING, radiance: [plane(3), plane(5), plane(11)] }
}

fn camera() -> Camera {
    let side = u32::try_from(SIZE).unwrap_or(u32::MAX);
    Camera::pinhole(side, side, 470.0)
}

/// A camera with all noise, three full planes, and a blur of so many pixels.
fn model(sigma_px: f64) -> CameraModel {
    let mut model = CameraModel::default();
    model.optics.gaussian_sigma_px = sigma_px;
    model.sensor = Some(Sensor {
        pixel_pitch_um: 5.86,
        quantum_efficiency: [0.62, 0.77, 0.62],
        wavelength_nm: [620.0, 525.0, 465.0],
        irradiance_uw_cm2: 7.0,
        exposure_time_ms: 5.0,
        dark_current_e_per_s: 5.0,
        read_noise_e: 6.83,
        prnu: 0.008,
        dsnu_e: 2.0,
        full_well_e: 32691.0,
        gain_dn_per_e: 0.1225,
        black_level_dn: 40.0,
        bit_depth: 12,
    });
    model
}

/// Adds the stage's benchmarks.
pub fn define(c: &mut Criterion) {
    let (film, camera) = (film(), camera());
    let mut buffers = PhotographBuffers::default();
    let mut group = c.benchmark_group("expose");
    group.throughput(Throughput::Elements((SIZE * SIZE) as u64));
    let region = PixelRange { x0: 150, y0: 120, x1: 350, y1: 320 };
    // What a stage takes is what its line takes more than the one without it.
    let with = |change: &dyn Fn(&mut CameraModel)| {
        let mut model = model(0.5);
        change(&mut model);
        Photographer::new("bench", &model, None)
    };
    let noisy = with(&|_| ());
    let mosaic = |demosaic: Demosaic| {
        with(&move |model| {
            model.colour = Colour::Rggb;
            model.output.demosaic = demosaic;
        })
    };
    for (name, photographer, window) in [
        ("light/512x512", &with(&|model| model.sensor = None), None),
        ("light, noise/512x512", &noisy, None),
        ("light, noise/200x200", &noisy, Some(region)),
        ("light, noise, linear/512x512", &with(&|m| m.output.transfer = Curve::Linear), None),
        ("light, noise, mono/512x512", &with(&|model| model.colour = Colour::Mono), None),
        ("light, noise, mosaic/512x512", &mosaic(Demosaic::Raw), None),
        ("light, noise, mosaic, bilinear/512x512", &mosaic(Demosaic::Bilinear), None),
        ("light, noise, mosaic, malvar/512x512", &mosaic(Demosaic::Malvar), None),
        ("light, noise, jpeg/512x512", &with(&|model| model.output.jpeg_quality = 90), None),
    ] {
        let kernel = photographer.kernel(OVERSAMPLING, [0.2, -0.3]);
        let shot = Shot { name: &["bench"], window };
        group.bench_function(name, |b| {
            b.iter(|| photographer.expose(&film, &camera, &kernel, &shot, &mut buffers));
        });
    }
    let bent = with(&|model| model.optics.distortion.k1 = -0.05);
    group.bench_function("lens/512x512", |b| {
        b.iter(|| bent.through_lens(&film, &camera).expect("one to one"));
    });
    let rays = RangeRays {
        points: Plane::filled(32, 32, None),
        depth_m: Plane::from_fn(256, 256, |x, y| if x > 100 && y > 80 { 1.0 } else { 2.0 }),
    };
    let range_camera = camera.resized([32, 32]);
    let sensor = RangeSensor {
        width: 128,
        height: 128,
        noise_m: 0.01,
        baseline_m: 0.1,
        ..RangeSensor::default()
    };
    group.bench_function("range/128x128", |b| {
        b.iter(|| sensor.measure(&rays, &range_camera, Pose::identity(), &["bench"]));
    });
    let whole = PixelRange { x0: 0, y0: 0, x1: SIZE, y1: SIZE };
    let mut disc = CameraModel::default();
    disc.optics.defocus_radius_px = 2.0;
    let disc = Photographer::new("bench", &disc, None);
    for (name, photographer) in [("gaussian", &noisy), ("disc", &disc)] {
        group.bench_function(format!("kernel/{name}"), |b| {
            b.iter(|| photographer.kernel(OVERSAMPLING, [0.2, -0.3]));
        });
        let kernel = photographer.kernel(OVERSAMPLING, [0.2, -0.3]);
        let (mut gather, mut light) = (GatherBuffers::default(), Plane::filled(SIZE, SIZE, 0.0));
        group.bench_function(format!("gather/{name}/one plane"), |b| {
            b.iter(|| kernel.gather(&film.radiance[0], whole, &mut gather, &mut light));
        });
    }
    group.finish();
    if crate::asked("expose/threads") {
        by_threads(&noisy, &film, &camera);
    }
    if crate::asked("expose/peers")
        && let Some(python) = python()
    {
        beside_numpy(&python, &noisy, &film, &camera);
    }
}

/// Prints how many more photographs all cores take in a second than one does, in turns.
fn by_threads(photographer: &Photographer, film: &Film, camera: &Camera) {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let kernel = photographer.kernel(OVERSAMPLING, [0.2, -0.3]);
    let faster = speed_up(cores, || {
        let begun = Instant::now();
        (0..16 * cores).into_par_iter().for_each_init(PhotographBuffers::default, |b, number| {
            let shot = Shot { name: &["bench", &number.to_string()], window: None };
            std::hint::black_box(photographer.expose(film, camera, &kernel, &shot, b));
        });
        begun.elapsed().as_secs_f64()
    });
    println!("expose: {faster:.2} times as many with {cores} threads as with one");
}

/// Prints how long NumPy and we take for the same photograph, on one core, in turns.
fn beside_numpy(python: &Path, photographer: &Photographer, film: &Film, camera: &Camera) {
    let folder = std::env::temp_dir().join(format!("cornerbench-bench-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let path = |name: &str| folder.join(name);
    let bytes: Vec<u8> = film
        .radiance
        .iter()
        .flat_map(|plane| plane.samples().iter().flat_map(|value| value.to_le_bytes()))
        .collect();
    std::fs::write(path("film.f32"), bytes).expect("written");
    let (model, phase_px) = (photographer.model(), [0.2, -0.3]);
    let settings = serde_json::json!({
        "oversampling": OVERSAMPLING, "side_px": SIZE, "phase_px": phase_px, "repeats": 3,
        "camera": model,
    });
    std::fs::write(path("settings.json"), settings.to_string()).expect("written");
    let kernel = photographer.kernel(OVERSAMPLING, phase_px);
    let shot = Shot { name: &["bench"], window: None };
    let mut buffers = PhotographBuffers::default();
    let ratios = (0..5).map(|_| {
        let ours = Times::of(15, || {
            std::hint::black_box(photographer.expose(film, camera, &kernel, &shot, &mut buffers));
        });
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/tests/peers/exposure_oracle.py");
        let output = Command::new(python)
            .arg(script)
            .args([path("film.f32"), path("out.f32"), path("settings.json")])
            .env("OMP_NUM_THREADS", "1")
            .output()
            .expect("Python");
        let theirs_s: f64 =
            String::from_utf8_lossy(&output.stdout).trim().parse().expect("seconds");
        println!("expose: NumPy {theirs_s:.3} s, ours {:.4} s", ours.median_s);
        theirs_s / ours.median_s
    });
    println!("expose: {:.0} times as fast as NumPy", Spread::of(ratios.collect()));
    std::fs::remove_dir_all(&folder).expect("removed");
}
