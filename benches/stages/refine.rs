//! Corner refinement.

use cornerbench::detect::Detection;
use cornerbench::geometry::ImagePoint;
use cornerbench::refine::Refiner;
use cornerbench::refine::corner_sub_pix::CornerSubPix;
use criterion::{Criterion, Throughput};

use super::photograph::{COUNT, FIRST, STEP, copy, photograph};

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
}
