//! Photographs: light on the pixels, electrons, encoding, and all of it.
//!
//! With the environment variable `PYTHON` set to a Python with NumPy and SciPy, the version of the
//! camera in NumPy (`scripts/tests/peers/exposure_oracle.py`) is timed in the same run.

use std::process::Command;
use std::time::Instant;

use cornerbench::geometry::{Camera, Distortion};
use cornerbench::image::{PixelRange, Plane};
use cornerbench::scene::Film;
use cornerbench::sensor::{
    CameraModel, Colour, GatherBuffers, PhotographBuffers, Photographer, Sensor, Shot,
};
use criterion::{Criterion, Throughput};

use super::photograph::SIZE;

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
    let middle = 0.5 * (SIZE as f64 - 1.0);
    Camera {
        width: side,
        height: side,
        fx_px: 470.0,
        fy_px: 470.0,
        cx_px: middle,
        cy_px: middle,
        distortion: Distortion::NONE,
    }
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
    let noisy = Photographer::new("bench", &model(0.5), None);
    let mut webcam = model(0.7);
    webcam.colour = Colour::Rggb;
    let webcam = Photographer::new("bench", &webcam, None);
    let ideal = Photographer::new("bench", &CameraModel::default(), None);
    for (name, photographer, window) in [
        ("noisy-rgb/512x512", &noisy, None),
        ("noisy-rgb/200x200", &noisy, Some(region)),
        ("noisy-mosaic/512x512", &webcam, None),
        ("ideal/512x512", &ideal, None),
    ] {
        let kernel = photographer.kernel(OVERSAMPLING, [0.2, -0.3]);
        let shot = Shot { name: &["bench"], window };
        group.bench_function(name, |b| {
            b.iter(|| photographer.expose(&film, &camera, &kernel, &shot, &mut buffers));
        });
    }
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
    beside_numpy(&noisy, &film, &camera);
}

/// Prints how long NumPy and we take for the same photograph, on one core, in turns.
fn beside_numpy(photographer: &Photographer, film: &Film, camera: &Camera) {
    let Some(python) = std::env::var_os("PYTHON") else { return };
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
    let sensor = model.sensor.as_ref().expect("a sensor");
    let settings = serde_json::json!({
        "oversampling": OVERSAMPLING, "side_px": SIZE, "phase_px": phase_px, "repeats": 3,
        "sigma_px": model.optics.gaussian_sigma_px, "fill_factor": 1.0,
        "electrons_at_one": sensor.electrons_at_one(),
        "sensor": {
            "prnu": sensor.prnu, "dark_e": sensor.dark_e(), "full_well_e": sensor.full_well_e,
            "dsnu_e": sensor.dsnu_e, "read_noise_e": sensor.read_noise_e,
            "black_level_dn": sensor.black_level_dn, "gain_dn_per_e": sensor.gain_dn_per_e,
            "bit_depth": sensor.bit_depth,
        },
    });
    std::fs::write(path("settings.json"), settings.to_string()).expect("written");
    let kernel = photographer.kernel(OVERSAMPLING, phase_px);
    let shot = Shot { name: &["bench"], window: None };
    let mut buffers = PhotographBuffers::default();
    let mut ratios: Vec<f64> = (0..5)
        .map(|_| {
            let mut ours_s: Vec<f64> = (0..15)
                .map(|_| {
                    let begun = Instant::now();
                    std::hint::black_box(photographer.expose(
                        film,
                        camera,
                        &kernel,
                        &shot,
                        &mut buffers,
                    ));
                    begun.elapsed().as_secs_f64()
                })
                .collect();
            ours_s.sort_by(f64::total_cmp);
            let script =
                concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/tests/peers/exposure_oracle.py");
            let output = Command::new(&python)
                .arg(script)
                .args([path("film.f32"), path("out.f32"), path("settings.json")])
                .env("OMP_NUM_THREADS", "1")
                .output()
                .expect("Python");
            let theirs_s: f64 =
                String::from_utf8_lossy(&output.stdout).trim().parse().expect("seconds");
            println!("expose: NumPy {theirs_s:.3} s, ours {:.4} s", ours_s[7]);
            theirs_s / ours_s[7]
        })
        .collect();
    ratios.sort_by(f64::total_cmp);
    println!(
        "expose: {:.0} times as fast as NumPy ({:.0} to {:.0})",
        ratios[2], ratios[0], ratios[4]
    );
    std::fs::remove_dir_all(&folder).expect("removed");
}
