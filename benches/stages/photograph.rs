//! The photograph that every stage is timed on, the least that could be done with it, and a texture.

use cornerbench::image::Plane;
use cornerbench::sensor::{Encoding, Exposure, Transfer};
use criterion::{Criterion, Throughput};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

/// Columns and rows \[px\], as in the paper.
pub const SIZE: usize = 512;

/// Corners of the chessboard drawn on the target: pixels `FIRST + n * STEP`, n in 0..COUNT, less
/// half a pixel both ways.
pub const FIRST: usize = 152;
/// Pixels from corner to corner.
pub const STEP: usize = 24;
/// Corners in a row.
pub const COUNT: usize = 9;

/// A red target of 240 x 240 pixels, a chessboard of light and dark red drawn on it, on grey ground
/// with texture.
pub fn photograph() -> Exposure {
    let on_target = |x: usize, y: usize| {
        let span = FIRST - STEP..FIRST + COUNT * STEP;
        (span.contains(&x) && span.contains(&y)).then(|| (x - 8) / STEP % 2 == (y - 8) / STEP % 2)
    };
    let channel = |ground: usize, light: f32, dark: f32| {
        Plane::from_fn(SIZE, SIZE, |x, y| match on_target(x, y) {
            Some(true) => light,
            Some(false) => dark,
            None => (ground + (x * 7 + y * 13) * (x ^ y) % 23) as f32,
        })
    };
    Exposure::new(
        [channel(90, 240.0, 180.0), channel(95, 60.0, 10.0), channel(80, 55.0, 12.0)],
        Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 },
    )
    .expect("finite")
}

/// A grey picture of corners everywhere: squares of 16 pixels, each of some shade, with a little noise;
/// the same in every run.
pub fn texture(width: usize, height: usize) -> Exposure {
    const SQUARE_PX: usize = 16;
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut shade = |count: u32| (random.next_u32() % count) as f32;
    let columns = width.div_ceil(SQUARE_PX);
    let shades: Vec<f32> =
        (0..columns * height.div_ceil(SQUARE_PX)).map(|_| 20.0 + shade(211)).collect();
    let grey = Plane::from_fn(width, height, |x, y| {
        shades[y / SQUARE_PX * columns + x / SQUARE_PX] + shade(5)
    });
    of_grey(grey)
}

/// An exposure whose red, green, blue and luma are alike \[DN\].
pub fn of_grey(grey: Plane<f32>) -> Exposure {
    let encoding = Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 };
    Exposure::new([grey.clone(), grey.clone(), grey], encoding).expect("finite")
}

/// Times a copy of one plane of the photograph, as `<stage>/copy/512x512`: the scale to read the
/// stage's other times on.
pub fn copy(c: &mut Criterion, stage: &str) {
    let exposure = photograph();
    let plane = exposure.luma();
    let mut copied = plane.clone();
    let mut group = c.benchmark_group(stage);
    group.throughput(Throughput::Elements((SIZE * SIZE) as u64));
    group.bench_function(format!("copy/{SIZE}x{SIZE}"), |b| {
        b.iter(|| copied.samples_mut().copy_from_slice(std::hint::black_box(plane.samples())));
    });
    group.finish();
    assert_eq!(&copied, plane);
}
