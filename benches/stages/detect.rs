//! Corner detection.
//!
//! With the environment variable `PYTHON` set to a Python with OpenCV, OpenCV is timed on the same
//! picture in the same run (`scripts/tests/peers/opencv_detectors.py`).

use std::process::Command;
use std::time::Instant;

use cornerbench::detect::Detector;
use cornerbench::detect::good_features::GoodFeatures;
use cornerbench::detect::harris::Harris;
use cornerbench::detect::shi_tomasi::ShiTomasi;
use cornerbench::detect::tensor::{Derivative, Measure, StructureTensor, TensorBuffers, Window};
use cornerbench::filter::Border;
use cornerbench::image::Plane;
use cornerbench::sensor::Exposure;
use cornerbench::target::TargetExtractor;
use cornerbench::target::red_difference::RedDifference;
use criterion::{Criterion, Throughput};

use super::photograph::{COUNT, SIZE, copy, photograph};

/// The tensor as OpenCV measures it.
fn box_tensor() -> StructureTensor {
    StructureTensor {
        derivative: Derivative::Sobel,
        window: Window::Box,
        border: Border::Reflect,
        ..StructureTensor::default()
    }
}

/// Adds the stage's benchmarks.
pub fn define(c: &mut Criterion) {
    copy(c, "detect");
    let exposure = photograph();
    exposure.luma(); // computed once per exposure, not once per detection
    let region = RedDifference::default().extract(&exposure).expect("a red target");
    let central = Harris::default();
    let gaussian = Harris {
        tensor: StructureTensor { derivative: Derivative::Gaussian, ..Default::default() },
        ..Harris::default()
    };
    for detector in [&central, &gaussian] {
        assert!(detector.detect(&exposure, Some(&region)).len() >= COUNT * COUNT);
    }

    let mut group = c.benchmark_group("detect");
    group.throughput(Throughput::Elements((SIZE * SIZE) as u64));
    for (name, tensor) in [("gaussian", &central.tensor), ("box", &box_tensor())] {
        group.bench_function(format!("harris_response/{name}/{SIZE}x{SIZE}"), |b| {
            let mut response = Response::new(&exposure, tensor);
            b.iter(|| response.take(&exposure, &central));
        });
    }
    group.bench_function(format!("harris/{SIZE}x{SIZE}"), |b| {
        b.iter(|| central.detect(&exposure, None));
    });
    group.bench_function(format!("harris_gaussian/{SIZE}x{SIZE}"), |b| {
        b.iter(|| gaussian.detect(&exposure, None));
    });
    let good = GoodFeatures::default();
    group.bench_function(format!("good_features/{SIZE}x{SIZE}"), |b| {
        b.iter(|| good.detect(&exposure, None));
    });
    group.throughput(Throughput::Elements(region.pixels as u64));
    group.bench_function("harris/region", |b| {
        b.iter(|| central.detect(&exposure, Some(&region)));
    });
    group.finish();
    beside_opencv(&exposure);
}

/// A response with its memory.
struct Response {
    kernels: cornerbench::detect::tensor::TensorKernels,
    buffers: TensorBuffers,
    response: Plane<f32>,
}

impl Response {
    fn new(exposure: &Exposure, tensor: &StructureTensor) -> Self {
        Self {
            kernels: tensor.kernels(),
            buffers: TensorBuffers::default(),
            response: Plane::filled(exposure.width(), exposure.height(), 0.0),
        }
    }

    fn take(&mut self, exposure: &Exposure, measure: &impl Measure) {
        let luma = [(exposure.luma().view(), 1.0)];
        self.kernels.response(&luma, &mut self.buffers, measure, &mut self.response);
        std::hint::black_box(&self.response);
    }
}

/// Prints how long OpenCV and we take for the same, on one core, in turns.
fn beside_opencv(exposure: &Exposure) {
    const ROUNDS: usize = 7;
    let Some(python) = std::env::var_os("PYTHON") else { return };
    let folder = std::env::temp_dir().join(format!("cornerbench-detect-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let picture = folder.join("luma.png");
    exposure.to_picture().save(&picture).expect("written");
    let (boxed, gaussian) = (box_tensor(), StructureTensor::default());
    let (harris, eigenvalue) = (Harris::default(), ShiTomasi::default());
    let good = GoodFeatures::default();
    let (mut boxed, mut gaussian) =
        (Response::new(exposure, &boxed), Response::new(exposure, &gaussian));
    let mut once = |name: &str| match name {
        "harris" => boxed.take(exposure, &harris),
        "min_eigenvalue" => boxed.take(exposure, &eigenvalue),
        "gaussian_harris" => gaussian.take(exposure, &harris),
        _ => drop(std::hint::black_box(good.detect(exposure, None))),
    };
    let names = ["harris", "min_eigenvalue", "gaussian_harris", "good_features"];
    let mut ratios = names.map(|_| Vec::new());
    let mut ours_ms = names.map(|_| Vec::new());
    for _ in 0..ROUNDS {
        let ours_s = names.map(|name| {
            let mut took_s: Vec<f64> = (0..51)
                .map(|_| {
                    let begun = Instant::now();
                    once(name);
                    begun.elapsed().as_secs_f64()
                })
                .collect();
            took_s.sort_by(f64::total_cmp);
            took_s[25]
        });
        let script =
            concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/tests/peers/opencv_detectors.py");
        let output = Command::new(&python)
            .arg(script)
            .args([&picture, &folder])
            .arg("51")
            .output()
            .expect("Python");
        let said: serde_json::Value =
            serde_json::from_slice(&output.stdout).expect("JSON: does PYTHON have OpenCV?");
        for ((index, name), ours_s) in names.iter().enumerate().zip(ours_s) {
            ratios[index].push(said["took_s"][name].as_f64().expect("seconds") / ours_s);
            ours_ms[index].push(1e3 * ours_s);
        }
    }
    for ((name, mut ratios), mut ours_ms) in names.iter().zip(ratios).zip(ours_ms) {
        ratios.sort_by(f64::total_cmp);
        ours_ms.sort_by(f64::total_cmp);
        println!(
            "detect: {name} {:.3} ms, {:.1} times as fast as OpenCV ({:.1} to {:.1})",
            ours_ms[ROUNDS / 2],
            ratios[ROUNDS / 2],
            ratios[0],
            ratios[ROUNDS - 1]
        );
    }
    std::fs::remove_dir_all(&folder).expect("removed");
}
