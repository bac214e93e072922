//! Responses of detectors: slow, obvious second versions.

#![allow(clippy::cast_possible_truncation, reason = "small numbers, drawn here")]

use cornerbench::detect::fast::Fast;
use cornerbench::detect::foerstner::Foerstner;
use cornerbench::detect::harris::Harris;
use cornerbench::detect::hessian_determinant::HessianDeterminant;
use cornerbench::detect::jet::Jet;
use cornerbench::detect::kitchen_rosenfeld::KitchenRosenfeld;
use cornerbench::detect::noble::Noble;
use cornerbench::detect::rohr::Rohr;
use cornerbench::detect::shi_tomasi::ShiTomasi;
use cornerbench::detect::susan::Susan;
use cornerbench::detect::tensor::{Derivative, Measure, StructureTensor, TensorBuffers, Window};
use cornerbench::detect::{Detection, Detector, Peaks};
use cornerbench::geometry::ImagePoint;
use cornerbench::image::{PixelRange, Plane};
use cornerbench::target::TargetRegion;

use crate::drawn::{grey, texture};

/// Texture of every contrast, with flat parts and a strong edge.
fn textured(width: usize, height: usize) -> Plane<f32> {
    Plane::from_fn(width, height, |x, y| {
        let contrast = (x / 16 + y / 16) as f32 / ((width + height) / 16) as f32;
        let base = if 2 * x > 3 * y { 30.0 } else { 120.0 };
        (base + 0.5 * contrast * texture(x, y)).round()
    })
}

// ---- The structure tensor -----------------------------------------------------------------------------------

/// exp(-d^2 / 2 sigma^2) at d = -ceil(3 sigma), ..., ceil(3 sigma).
fn bell(sigma: f64) -> Vec<(isize, f64)> {
    let radius = (3.0 * sigma).ceil() as isize;
    (-radius..=radius).map(|d| (d, (-0.5 * (d as f64 / sigma).powi(2)).exp())).collect()
}

/// The derivative's kernel along and across, as (offset, weight).
fn slopes(tensor: &StructureTensor) -> [Vec<(isize, f64)>; 2] {
    let central = vec![(-1, -0.5), (1, 0.5)];
    match tensor.derivative {
        Derivative::Central => [central, vec![(0, 1.0)]],
        Derivative::Sobel => [central, vec![(-1, 0.25), (0, 0.5), (1, 0.25)]],
        Derivative::Scharr => [central, vec![(-1, 3.0 / 16.0), (0, 0.625), (1, 3.0 / 16.0)]],
        Derivative::Gaussian => {
            let bell = bell(tensor.sigma_d);
            let area: f64 = bell.iter().map(|(_, g)| g).sum();
            let slope: f64 = bell.iter().map(|&(d, g)| (d * d) as f64 * g).sum();
            let along = bell.iter().map(|&(d, g)| (d, d as f64 * g / slope)).collect();
            [along, bell.iter().map(|&(d, g)| (d, g / area)).collect()]
        }
    }
}

/// A, B and C as their definition has it: one double sum over the window at each pixel.
fn direct_tensor(tensor: &StructureTensor, plane: &Plane<f32>) -> Plane<[f64; 3]> {
    let (width, height) = (plane.width(), plane.height());
    let [along, across] = slopes(tensor);
    let gradient = Plane::from_fn(width, height, |x, y| {
        let (mut ix, mut iy) = (0.0, 0.0);
        for &(d, derivative) in &along {
            for &(e, smoothing) in &across {
                let at = |dx, dy| {
                    f64::from(plane.at_replicated(x.cast_signed() + dx, y.cast_signed() + dy))
                };
                ix += derivative * smoothing * at(d, e);
                iy += derivative * smoothing * at(e, d);
            }
        }
        (ix, iy)
    });
    let window = bell(tensor.sigma_i);
    Plane::from_fn(width, height, |x, y| {
        let (mut sums, mut area) = ([0.0; 3], 0.0);
        for &(dy, gy) in &window {
            for &(dx, gx) in &window {
                let (ix, iy) = gradient.at_replicated(x.cast_signed() + dx, y.cast_signed() + dy);
                for (sum, product) in sums.iter_mut().zip([ix * ix, iy * iy, ix * iy]) {
                    *sum += gx * gy * product;
                }
                area += gx * gy;
            }
        }
        sums.map(|sum| sum / area)
    })
}

/// What a detector makes of a tensor.
fn response(tensor: &StructureTensor, plane: &Plane<f32>, measure: &impl Measure) -> Plane<f32> {
    let mut response = Plane::filled(plane.width(), plane.height(), f32::NAN);
    let buffers = &mut TensorBuffers::default();
    tensor.kernels().response(&[(plane.view(), 1.0)], buffers, measure, &mut response);
    response
}

#[test]
fn measures_of_the_tensor_match_direct_sums() {
    let plane = textured(83, 61);
    let close = |name: &str, found: &Plane<f32>, expected: &Plane<f64>| {
        let scale = expected.samples().iter().fold(0.0, |max: f64, r| max.max(r.abs()));
        for (&found, &expected) in found.samples().iter().zip(expected.samples()) {
            let error = (f64::from(found) - expected).abs() / scale;
            assert!(error < 1e-5, "{name}: {found} is not {expected}: {error:e} of the largest");
        }
    };
    for derivative in
        [Derivative::Central, Derivative::Sobel, Derivative::Scharr, Derivative::Gaussian]
    {
        for sigma_i in [0.8, 1.5, 3.0] {
            let tensor =
                StructureTensor { derivative, sigma_i, sigma_d: 1.2, ..Default::default() };
            let direct = direct_tensor(&tensor, &plane);
            let by =
                |formula: &dyn Fn(f64, f64, f64) -> f64| direct.map(|[a, b, c]| formula(a, b, c));
            let harris = Harris::default();
            close(
                "harris",
                &response(&tensor, &plane, &harris),
                &by(&|a, b, c| a * b - c * c - harris.k * (a + b).powi(2)),
            );
            close(
                "shi_tomasi",
                &response(&tensor, &plane, &ShiTomasi::default()),
                &by(&|a, b, c| {
                    let eigenvalues = nalgebra::Matrix2::new(a, c, c, b).symmetric_eigenvalues();
                    eigenvalues.min()
                }),
            );
            close(
                "noble",
                &response(&tensor, &plane, &Noble::default()),
                &by(&|a, b, c| (a * b - c * c) / (a + b + 1e-6)),
            );
            close(
                "rohr",
                &response(&tensor, &plane, &Rohr::default()),
                &by(&|a, b, c| a * b - c * c),
            );
            let foerstner = Foerstner { roundness: 0.6, ..Foerstner::default() };
            let found = response(&tensor, &plane, &foerstner);
            for (found, [a, b, c]) in found.samples().iter().zip(direct.samples()) {
                let (determinant, trace) = (a * b - c * c, a + b + 1e-6);
                let q = 4.0 * determinant / (trace * trace);
                if (q - 0.6).abs() > 1e-4 {
                    let expected = if q > 0.6 { determinant / trace } else { 0.0 };
                    let error = (f64::from(*found) - expected).abs();
                    assert!(error <= 1e-4 * expected, "{found} is not {expected}, q is {q}");
                }
            }
        }
    }
}

/// `out[x]` = sum of `taps` times the samples around x, one after the other; the border is replicated.
fn plainly(taps: &[(isize, f64)], at: impl Fn(isize) -> f32) -> f32 {
    taps.iter().fold(0.0, |sum: f32, &(d, tap)| (tap as f32).mul_add(at(d), sum))
}

#[test]
fn the_vectors_tensor_is_the_plain_one() {
    let plane = textured(403, 61); // of three tiles
    let (width, height) = (plane.width(), plane.height());
    for (derivative, sigma_i) in
        [(Derivative::Central, 1.5), (Derivative::Gaussian, 1.5), (Derivative::Sobel, 2.1)]
    {
        let tensor = StructureTensor { derivative, sigma_i, ..Default::default() };
        let [along, across] = slopes(&tensor);
        let bell = bell(sigma_i);
        let area: f64 = bell.iter().map(|(_, g)| g).sum();
        let window: Vec<(isize, f64)> = bell.iter().map(|&(d, g)| (d, g / area)).collect();
        let filtered = |plane: &Plane<f32>, taps: &[(isize, f64)], in_x: bool| {
            Plane::from_fn(width, height, |x, y| {
                plainly(taps, |d| {
                    let (dx, dy) = if in_x { (d, 0) } else { (0, d) };
                    plane.at_replicated(x.cast_signed() + dx, y.cast_signed() + dy)
                })
            })
        };
        let ix = filtered(&filtered(&plane, &across, false), &along, true);
        let iy = filtered(&filtered(&plane, &along, false), &across, true);
        let average = |p: &Plane<f32>, q: &Plane<f32>| {
            let product = Plane::from_fn(width, height, |x, y| p.at(x, y) * q.at(x, y));
            filtered(&filtered(&product, &window, true), &window, false)
        };
        let [a, b, c] = [average(&ix, &ix), average(&iy, &iy), average(&ix, &iy)];
        let harris = Harris::default();
        let found = response(&tensor, &plane, &harris);
        let plain =
            Plane::from_fn(width, height, |x, y| harris.of(a.at(x, y), b.at(x, y), c.at(x, y)));
        let largest = plain.samples().iter().fold(0.0, |most: f32, r| most.max(r.abs()));
        for (found, plain) in found.samples().iter().zip(plain.samples()) {
            assert!((found - plain).abs() <= 1e-6 * largest, "{found} {plain} of {largest}");
        }
    }
}

/// A tensor as OpenCV measures it, at pixels whose support is in the image: computed in registers.
#[test]
fn a_tensor_of_three_taps_matches_direct_sums_and_the_tiles() {
    let plane = textured(83, 61);
    for (derivative, side) in
        [(Derivative::Sobel, 0.25), (Derivative::Scharr, 3.0 / 16.0), (Derivative::Central, 0.0)]
    {
        let tensor = StructureTensor { derivative, window: Window::Box, ..Default::default() };
        let harris = Harris::default();
        let found = response(&tensor, &plane, &harris);
        // Of two planes the tensor is computed in tiles.
        let mut tiled = Plane::filled(83, 61, f32::NAN);
        let planes = [(plane.view(), 0.5), (plane.view(), 0.5)];
        let buffers = &mut TensorBuffers::default();
        tensor.kernels().response(&planes, buffers, &harris, &mut tiled);
        let largest = tiled.samples().iter().fold(0.0, |most: f32, r| most.max(r.abs()));
        for (found, tiled) in found.samples().iter().zip(tiled.samples()) {
            assert!((found - tiled).abs() <= 1e-6 * largest, "{found} {tiled} of {largest}");
        }
        for y in 2..59_usize {
            for x in 2..81_usize {
                let [mut a, mut b, mut c] = [0.0; 3];
                for (v, u) in (y - 1..=y + 1).flat_map(|v| (x - 1..=x + 1).map(move |u| (v, u))) {
                    let at = |dx: isize, dy: isize| {
                        f64::from(plane.at(u.wrapping_add_signed(dx), v.wrapping_add_signed(dy)))
                    };
                    let middle = 1.0 - 2.0 * side;
                    let slope = |at: &dyn Fn(isize, isize) -> f64| {
                        let row = |e| 0.5 * (at(1, e) - at(-1, e));
                        side * (row(-1) + row(1)) + middle * row(0)
                    };
                    let (ix, iy) = (slope(&at), slope(&|d, e| at(e, d)));
                    a += ix * ix / 9.0;
                    b += iy * iy / 9.0;
                    c += ix * iy / 9.0;
                }
                let expected = a * b - c * c - harris.k * (a + b).powi(2);
                let error = (f64::from(found.at(x, y)) - expected).abs() / f64::from(largest);
                assert!(error <= 1e-6, "({x}, {y}): {} {expected}", found.at(x, y));
            }
        }
    }
}

// ---- Other responses ----------------------------------------------------------------------------------------

#[test]
fn measures_of_derivatives_match_direct_sums() {
    let plane = textured(60, 50);
    let sigma = 1.3;
    let bell = bell(sigma);
    let area: f64 = bell.iter().map(|(_, g)| g).sum();
    let square: f64 = bell.iter().map(|&(d, g)| (d * d) as f64 * g).sum();
    let smooth: Vec<(isize, f64)> = bell.iter().map(|&(d, g)| (d, g / area)).collect();
    let slope: Vec<(isize, f64)> = bell.iter().map(|&(d, g)| (d, d as f64 * g / square)).collect();
    let bend: Vec<(isize, f64)> =
        bell.iter().map(|&(d, g)| (d, g * ((d * d) as f64 - square / area))).collect();
    let curvature: f64 = bend.iter().map(|&(d, tap)| 0.5 * tap * (d * d) as f64).sum();
    let bend: Vec<(isize, f64)> = bend.iter().map(|&(d, tap)| (d, tap / curvature)).collect();
    let derivative = |in_x: &[(isize, f64)], in_y: &[(isize, f64)], x: usize, y: usize| -> f64 {
        let at = |dx: isize, dy: isize| {
            f64::from(plane.at_replicated(x.cast_signed() + dx, y.cast_signed() + dy))
        };
        let of_row = |dy: isize| in_x.iter().map(|&(dx, tap)| tap * at(dx, dy)).sum::<f64>();
        in_y.iter().map(|&(dy, tap)| tap * of_row(dy)).sum()
    };
    let direct = Plane::from_fn(60, 50, |x, y| {
        let ix = derivative(&slope, &smooth, x, y);
        let iy = derivative(&smooth, &slope, x, y);
        let ixx = derivative(&bend, &smooth, x, y);
        let ixy = derivative(&slope, &slope, x, y);
        let iyy = derivative(&smooth, &bend, x, y);
        let turned = ixx * iy * iy - 2.0 * ixy * ix * iy + iyy * ix * ix;
        [sigma.powi(4) * (ixx * iyy - ixy * ixy), turned.abs() / (ix * ix + iy * iy + 1e-6)]
    });
    let peaks = Peaks { threshold_rel: 0.0, nms_radius_px: 1, ..Peaks::default() };
    let jet = Jet { sigma_d: sigma, ..Jet::default() };
    let exposure = grey(plane.clone());
    let determinant = HessianDeterminant { jet: jet.clone(), peaks: peaks.clone() };
    let curvature = KitchenRosenfeld { jet, peaks };
    for (which, detector) in [&determinant as &dyn Detector, &curvature].into_iter().enumerate() {
        let largest = direct.samples().iter().fold(0.0, |most: f64, r| most.max(r[which].abs()));
        let is_peak = |x: usize, y: usize| {
            let here = direct.at(x, y)[which];
            let mut around = (y - 1..=y + 1).flat_map(|v| (x - 1..=x + 1).map(move |u| (u, v)));
            around.all(|(u, v)| (u, v) == (x, y) || direct.at(u, v)[which] < here - 1e-5 * largest)
        };
        let found = detector.detect(&exposure, None);
        let border = 4;
        let mut clear = 0;
        for y in border..50 - border {
            for x in border..60 - border {
                let expected = direct.at(x, y)[which];
                if expected > 1e-4 * largest && is_peak(x, y) {
                    let place = ImagePoint::new(x as f64, y as f64);
                    let peak = found.iter().find(|peak| peak.point.distance_px(place) < 0.1);
                    let peak = peak.unwrap_or_else(|| panic!("{which}: none at ({x}, {y})"));
                    assert!(
                        (peak.response - expected).abs() < 1e-5 * largest,
                        "{peak:?} {expected}"
                    );
                    clear += 1;
                }
            }
        }
        assert!(clear > 20 && found.len() < 2 * clear, "{which}: {clear} of {}", found.len());
    }
}

#[test]
fn susan_matches_its_definition() {
    let plane = textured(50, 40);
    let susan = Susan::default();
    let mut found = Plane::default();
    susan.score(plane.view(), 255.0, &mut found);
    let (mut corners, mut barred) = (0, 0);
    for y in 3..37 {
        for x in 3..47 {
            let middle = f64::from(plane.at(x, y));
            let (mut area, mut moment) = (0.0, [0.0; 2]);
            for (dx, dy) in (-3_isize..=3).flat_map(|dx| (-3_isize..=3).map(move |dy| (dx, dy))) {
                // 37 pixels: those whose centres lie within 3.4 px.
                if ((dx * dx + dy * dy) as f64).sqrt() < 3.4 {
                    let sample = plane.at(x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
                    let share = (-((f64::from(sample) - middle) / 25.5).powi(6)).exp();
                    area += share;
                    moment[0] += share * dx as f64;
                    moment[1] += share * dy as f64;
                }
            }
            let score = f64::from(found.at(x, y));
            let centroid_px = (moment[0] / area).hypot(moment[1] / area);
            // From the middle on beyond the centre of gravity, as far as the disc goes.
            let mut way = (1..=3).filter_map(|step| {
                let [dx, dy] = moment.map(|m| (f64::from(step) * m / area / centroid_px).round());
                let (u, v) =
                    (x.wrapping_add_signed(dx as isize), y.wrapping_add_signed(dy as isize));
                (dx.hypot(dy) < 3.4).then(|| f64::from(plane.at(u, v)))
            });
            let is_open = way.all(|dn| (-((dn - middle) / 25.5).powi(6)).exp() > 0.5);
            if (area - 18.5).abs() > 1e-3 && (centroid_px - 0.7).abs() > 1e-3 {
                let is_corner = area < 18.5 && centroid_px > 0.7 && is_open;
                let expected = if is_corner { 18.5 - area } else { 0.0 };
                assert!((score - expected).abs() < 2e-3, "({x}, {y}): {score} is not {expected}");
                corners += usize::from(is_corner);
                barred += usize::from(area < 18.5 && centroid_px > 0.7 && !is_open);
            }
        }
    }
    assert!(corners > 15 && barred > 15, "{corners} {barred}");
}

#[test]
fn fast_matches_its_definition() {
    let plane = textured(70, 50);
    let circle: Vec<[f64; 2]> = vec![
        [0.0, -3.0],
        [1.0, -3.0],
        [2.0, -2.0],
        [3.0, -1.0],
        [3.0, 0.0],
        [3.0, 1.0],
        [2.0, 2.0],
        [1.0, 3.0],
        [0.0, 3.0],
        [-1.0, 3.0],
        [-2.0, 2.0],
        [-3.0, 1.0],
        [-3.0, 0.0],
        [-3.0, -1.0],
        [-2.0, -2.0],
        [-1.0, -3.0],
    ];
    for arc in 9..=12 {
        let mut found = Plane::default();
        Fast { arc_px: arc, ..Fast::default() }.score(plane.view(), 0.0, &mut found);
        for y in 3..47 {
            for x in 3..67 {
                let middle = plane.at(x, y);
                let ring: Vec<f32> = circle
                    .iter()
                    .map(|[dx, dy]| {
                        let at =
                            |centre: usize, step: f64| centre.wrapping_add_signed(step as isize);
                        plane.at(at(x, *dx), at(y, *dy)) - middle
                    })
                    .collect();
                // Whole numbers: try every threshold.
                let is_corner = |s: f32| {
                    (0..16).any(|start| {
                        let on = |test: &dyn Fn(f32) -> bool| {
                            (0..arc as usize).all(|step| test(ring[(start + step) % 16]))
                        };
                        on(&|d| d >= s) || on(&|d| d <= -s)
                    })
                };
                let wanted = (1..=255).rev().map(|s| s as f32).find(|&s| is_corner(s));
                let (found, wanted) = (found.at(x, y), wanted.unwrap_or(0.0));
                assert!((found - wanted).abs() < 0.5, "{arc} {x} {y}: {found} is not {wanted}");
            }
        }
        assert!(found.row(2).iter().chain(found.row(47)).all(|&s| s == 0.0));
        // What need not be known may be 0, and a row may be shorter than a vector, or than four.
        let (fast, least_dn) = (Fast { arc_px: arc, ..Fast::default() }, 12.0);
        for width in 1..=70 {
            let range = PixelRange { x0: 0, y0: 0, x1: width, y1: 50 };
            let mut part = Plane::default();
            fast.score(plane.view().crop(range), least_dn, &mut part);
            for y in 0..50 {
                for x in 0..width {
                    let known = found.at(x, y) > least_dn && x + 3 < width;
                    let wanted = if known { found.at(x, y) } else { 0.0 };
                    let (score, whole) = (part.at(x, y), found.at(x, y));
                    let is = |value: f32| (score - value).abs() < 1e-6;
                    assert!(is(wanted) || (!known && is(whole)), "{arc} {width} {x} {y}");
                }
            }
        }
    }
}

#[test]
fn harris_on_a_region_equals_harris_on_the_image() {
    let exposure = grey(textured(150, 120));
    let region = |corners: [[f64; 2]; 4]| TargetRegion {
        mask: Plane::filled(150, 120, false),
        range: PixelRange { x0: 0, y0: 0, x1: 1, y1: 1 },
        quadrilateral: corners.map(ImagePoint::from),
        pixels: 1,
    };
    let regions = [
        region([[60.5, 40.5], [90.5, 40.5], [90.5, 70.5], [60.5, 70.5]]),
        region([[70.0, 20.0], [120.0, 70.0], [90.0, 100.0], [40.0, 50.0]]), // turned by 45 degrees
        region([[-20.5, 80.5], [30.5, 80.5], [30.5, 140.5], [-20.5, 140.5]]), // across a corner
    ];
    for derivative in [Derivative::Central, Derivative::Gaussian] {
        let harris = Harris {
            tensor: StructureTensor { derivative, ..Default::default() },
            peaks: Peaks { threshold_rel: 0.0, nms_radius_px: 1, ..Peaks::default() },
            ..Harris::default()
        };
        let everywhere = harris.detect(&exposure, None);
        for region in &regions {
            let [p0, p1, _, p3] = region.quadrilateral;
            // Distances along the two sides that meet in p0; each side grows by the margin.
            let along = |point: ImagePoint, end: ImagePoint| {
                let length = p0.distance_px(end);
                let t = ((point.x - p0.x) * (end.x - p0.x) + (point.y - p0.y) * (end.y - p0.y))
                    / length;
                (-harris.peaks.margin_px..=length + harris.peaks.margin_px).contains(&t)
            };
            let expected: Vec<Detection> = everywhere
                .iter()
                .filter(|found| along(found.point, p1) && along(found.point, p3))
                .copied()
                .collect();
            assert!(expected.len() > 10, "{} is too few to compare", expected.len());
            assert_eq!(harris.detect(&exposure, Some(region)), expected);
        }
    }
}
