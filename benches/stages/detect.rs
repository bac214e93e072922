//! Corner detection: every detector as a plan without parameters has it, and what they are made of.

use cornerbench::detect::harris::Harris;
use cornerbench::detect::tensor::{
    Derivative, Measure, StructureTensor, TensorBuffers, TensorKernels, Window,
};
use cornerbench::detect::{DETECTORS, Detector, Scratch};
use cornerbench::filter::Border;
use cornerbench::image::Plane;
use cornerbench::sensor::Exposure;
use cornerbench::target::TargetExtractor;
use cornerbench::target::red_difference::RedDifference;
use criterion::{Criterion, Throughput};
use rayon::prelude::*;

use super::peers;
use super::photograph::{COUNT, SIZE, copy, photograph, texture};
use super::turns::{Times, pool, speed_up};

/// The tensor as OpenCV measures it.
pub fn box_tensor() -> StructureTensor {
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
    let (mut scratch, mut found) = (Scratch::default(), Vec::new());
    for entry in DETECTORS {
        let detector = (entry.build)("bench", &(entry.defaults)()).expect("defaults");
        group.bench_function(format!("{}/{SIZE}x{SIZE}", entry.name), |b| {
            b.iter(|| detector.detect_into(&exposure, None, &mut scratch, &mut found));
            assert!(!found.is_empty(), "{}", entry.name);
        });
    }
    group.bench_function(format!("harris_gaussian/{SIZE}x{SIZE}"), |b| {
        b.iter(|| gaussian.detect_into(&exposure, None, &mut scratch, &mut found));
    });
    for (name, tensor) in [("gaussian", &central.tensor), ("box", &box_tensor())] {
        group.bench_function(format!("harris_response/{name}/{SIZE}x{SIZE}"), |b| {
            let mut tensor = MeasuredTensor::new(tensor);
            let mut response = Plane::filled(SIZE, SIZE, 0.0);
            b.iter(|| tensor.respond(&exposure, &central, &mut response));
        });
    }
    group.throughput(Throughput::Elements(region.pixels as u64));
    group.bench_function("harris/region", |b| {
        b.iter(|| central.detect_into(&exposure, Some(&region), &mut scratch, &mut found));
    });
    group.finish();
    if crate::asked("detect/threads") {
        by_threads();
    }
    if crate::asked("detect/peers") {
        peers::compare();
    }
}

/// A structure tensor with its memory.
pub struct MeasuredTensor {
    kernels: TensorKernels,
    buffers: TensorBuffers,
}

impl MeasuredTensor {
    pub fn new(tensor: &StructureTensor) -> Self {
        Self { kernels: tensor.kernels(), buffers: TensorBuffers::default() }
    }

    /// A measure of it at every pixel of the luma; `response` is of its size.
    pub fn respond(
        &mut self,
        exposure: &Exposure,
        measure: &impl Measure,
        response: &mut Plane<f32>,
    ) {
        let luma = [(exposure.luma().view(), 1.0)];
        self.kernels.response(&luma, &mut self.buffers, measure, response);
        std::hint::black_box(response);
    }
}

/// Prints how much sooner two threads are done with a large picture than one is, in turns; and with
/// arithmetic that needs no memory: more than that a busy machine does not give.
fn by_threads() {
    const SIDE_PX: usize = 4096;
    const REPEATS: usize = 5;
    let exposure = texture(SIDE_PX, SIDE_PX);
    exposure.luma();
    let harris = Harris::default();
    let mut tensor = MeasuredTensor::new(&harris.tensor);
    let mut respond = || {
        let mut response = Plane::filled(SIDE_PX, SIDE_PX, 0.0);
        let mut once = || tensor.respond(&exposure, &harris, &mut response);
        once();
        (Times::of(REPEATS, once), response)
    };
    let [(_, one), (_, two)] = [1, 2].map(|threads| pool(threads).install(&mut respond));
    assert_eq!(one, two, "one thread responds otherwise than two");
    let response = speed_up(2, || respond().0.median_s);

    let detect = || {
        let (mut scratch, mut found) = (Scratch::default(), Vec::new());
        let mut once = || harris.detect_into(&exposure, None, &mut scratch, &mut found);
        once();
        (Times::of(REPEATS, once), found)
    };
    let [(_, one), (_, two)] = [1, 2].map(|threads| pool(threads).install(detect));
    assert!(one == two && !one.is_empty(), "one thread detects otherwise than two");
    let detection = speed_up(2, || detect().0.median_s);

    let arithmetic = || {
        (0..16_u64).into_par_iter().for_each(|seed| {
            let sum = (0..2_000_000).fold(seed, |sum: u64, n| (sum ^ n).wrapping_mul(seed | 1));
            std::hint::black_box(sum);
        });
    };
    let arithmetic = speed_up(2, || Times::of(REPEATS, arithmetic).median_s);
    for (what, faster) in [
        ("harris response, 4096x4096", response),
        ("harris detection, 4096x4096", detection),
        ("arithmetic alone", arithmetic),
    ] {
        println!("detect: {what}: {faster:.2} times as fast on two threads as on one");
    }
}
