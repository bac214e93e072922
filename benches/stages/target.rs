//! Target extraction.

use cornerbench::target::TargetExtractor;
use cornerbench::target::red_difference::RedDifference;
use criterion::{Criterion, Throughput};

use super::photograph::{COUNT, SIZE, STEP, copy, photograph};

/// Adds the stage's benchmarks.
pub fn define(c: &mut Criterion) {
    copy(c, "target");
    let exposure = photograph();
    let extractor = RedDifference::default();
    let region = extractor.extract(&exposure).expect("a red target");
    assert_eq!(region.pixels, ((COUNT + 1) * STEP).pow(2));

    let mut group = c.benchmark_group("target");
    group.throughput(Throughput::Elements((SIZE * SIZE) as u64));
    group.bench_function(format!("red_difference/{SIZE}x{SIZE}"), |b| {
        b.iter(|| extractor.extract(&exposure));
    });
    group.finish();
}
