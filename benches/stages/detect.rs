//! Corner detection.

use cornerbench::detect::Detector;
use cornerbench::detect::harris::{Derivative, Harris};
use cornerbench::target::TargetExtractor;
use cornerbench::target::red_difference::RedDifference;
use criterion::{Criterion, Throughput};

use super::photograph::{COUNT, SIZE, copy, photograph};

/// Adds the stage's benchmarks.
pub fn define(c: &mut Criterion) {
    copy(c, "detect");
    let exposure = photograph();
    exposure.luma(); // computed once per exposure, not once per detection
    let region = RedDifference::default().extract(&exposure).expect("a red target");
    let central = Harris::default();
    let gaussian = Harris { derivative: Derivative::Gaussian, ..Harris::default() };
    for detector in [&central, &gaussian] {
        assert!(detector.detect(&exposure, Some(&region)).len() >= COUNT * COUNT);
    }

    let mut group = c.benchmark_group("detect");
    group.throughput(Throughput::Elements((SIZE * SIZE) as u64));
    group.bench_function(format!("harris_response/{SIZE}x{SIZE}"), |b| {
        b.iter(|| central.response(exposure.luma()));
    });
    group.bench_function(format!("harris/{SIZE}x{SIZE}"), |b| {
        b.iter(|| central.detect(&exposure, None));
    });
    group.bench_function(format!("harris_gaussian/{SIZE}x{SIZE}"), |b| {
        b.iter(|| gaussian.detect(&exposure, None));
    });
    group.throughput(Throughput::Elements(region.pixels as u64));
    group.bench_function("harris/region", |b| {
        b.iter(|| central.detect(&exposure, Some(&region)));
    });
    group.finish();
}
