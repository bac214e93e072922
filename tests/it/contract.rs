//! What every algorithm promises, walked over every entry with its default parameters.

#![allow(clippy::cast_possible_truncation, reason = "small numbers, drawn here")]

use cornerbench::detect::{DETECTORS, Detection, Detector};
use cornerbench::geometry::ImagePoint;
use cornerbench::image::Plane;
use cornerbench::refine::{Corner, REFINERS};
use cornerbench::registry::Entry;
use cornerbench::sensor::{Encoding, Exposure};
use cornerbench::target::{EXTRACTORS, TargetExtractor, TargetRegion};
use nalgebra::Matrix2;
use toml::Table;

use crate::drawn::{colour, coverage, grey, seed, texture};

fn built<T: ?Sized>(entries: &'static [Entry<T>]) -> impl Iterator<Item = (&'static str, Box<T>)> {
    entries.iter().map(|entry| {
        let algorithm = (entry.build)(entry.name, &Table::new());
        (entry.name, algorithm.unwrap_or_else(|error| panic!("{}: {}", entry.name, error.chain())))
    })
}

const SIZE: [usize; 2] = [120, 90];

/// Vertices of the drawn shapes, before the shift.
const VERTICES: [[f64; 2]; 5] =
    [[30.0, 25.3], [66.2, 29.6], [59.4, 52.8], [27.1, 46.7], [46.4, 38.2]];

/// A red quadrilateral with two faces on grey ground, moved by whole pixels. Nothing changes near
/// the image's edges.
fn scene(shift_x: usize, shift_y: usize) -> Exposure {
    let [a, b, c, d, e] = VERTICES.map(|[x, y]| [x + shift_x as f64, y + shift_y as f64]);
    let left_of = |[x0, y0]: [f64; 2], [x1, y1]: [f64; 2], x: f64, y: f64| {
        (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) >= 0.0
    };
    let channel = |ground: f64, face: f64, other: f64| {
        Plane::from_fn(SIZE[0], SIZE[1], |x, y| {
            let whole = coverage(x, y, |x, y| {
                left_of(a, b, x, y)
                    && left_of(b, c, x, y)
                    && left_of(c, d, x, y)
                    && left_of(d, a, x, y)
            });
            let bright = coverage(x, y, |x, y| {
                left_of(a, b, x, y) && left_of(b, e, x, y) && left_of(e, a, x, y)
            });
            (ground + whole * (face - ground) + bright * (other - face)).round() as f32
        })
    };
    colour([channel(90.0, 230.0, 180.0), channel(90.0, 30.0, 10.0), channel(90.0, 40.0, 12.0)])
}

/// The exposure turned clockwise by 90 degrees: (x, y) becomes (height - 1 - y, x).
fn turned(exposure: &Exposure) -> Exposure {
    let (width, height) = (exposure.width(), exposure.height());
    let turn =
        |plane: &Plane<f32>| Plane::from_fn(height, width, |x, y| plane.at(y, height - 1 - x));
    Exposure::new(exposure.rgb().each_ref().map(turn), exposure.encoding()).expect("finite")
}

/// The exposure mirrored: (x, y) becomes (width - 1 - x, y).
fn mirrored(exposure: &Exposure) -> Exposure {
    let (width, height) = (exposure.width(), exposure.height());
    let mirror =
        |plane: &Plane<f32>| Plane::from_fn(width, height, |x, y| plane.at(width - 1 - x, y));
    Exposure::new(exposure.rgb().each_ref().map(mirror), exposure.encoding()).expect("finite")
}

/// The exposure in twice as many digital numbers of one bit more, and `offset_dn` added.
fn amplified(exposure: &Exposure, offset_dn: f32) -> Exposure {
    let encoding = exposure.encoding();
    let encoding = Encoding { bit_depth: encoding.bit_depth + 1, ..encoding };
    let planes = exposure.rgb().each_ref().map(|plane| plane.map(|dn| 2.0 * dn + offset_dn));
    Exposure::new(planes, encoding).expect("finite")
}

fn turned_point(point: ImagePoint, exposure: &Exposure) -> ImagePoint {
    ImagePoint::new(exposure.height() as f64 - 1.0 - point.y, point.x)
}

fn moved(point: ImagePoint, x: f64, y: f64) -> ImagePoint {
    ImagePoint::new(point.x + x, point.y + y)
}

fn vertex_seeds() -> Vec<Detection> {
    VERTICES.iter().map(|[x, y]| seed(x.round(), y.round())).collect()
}

/// Images that hold nothing to find, or next to nothing.
fn degenerate() -> Vec<Exposure> {
    let flat = |width, height, value| grey(Plane::filled(width, height, value));
    let red = |width, height| {
        colour([250.0, 10.0, 10.0].map(|value| Plane::filled(width, height, value)))
    };
    vec![
        flat(64, 48, 0.0),
        flat(64, 48, 128.0),
        flat(64, 48, 255.0),
        flat(1, 1, 7.0),
        flat(2, 3, 7.0),
        red(64, 48),
        red(1, 1),
        red(2, 3),
        grey(Plane::from_fn(2, 3, texture)),
        grey(Plane::from_fn(40, 40, texture)),
        grey(Plane::from_fn(15, 15, |x, _| if x < 7 { 10.0 } else { 240.0 })),
    ]
}

// ---- Every entry ------------------------------------------------------------------------------

fn entries_are_sound<T: ?Sized>(entries: &[Entry<T>]) {
    assert!(entries.is_sorted_by_key(|entry| entry.name), "in alphabetical order");
    for entry in entries {
        assert!(!entry.summary.is_empty() && !entry.reference.is_empty(), "{}", entry.name);
        assert!(entry.version >= 1, "{}", entry.name);
        let table = "no_such_parameter = 1".parse().expect("valid TOML");
        let error = (entry.build)("plan.toml", &table).err();
        let message = error.map(|error| error.chain()).unwrap_or_default();
        assert!(message.contains("plan.toml: unknown key \"no_such_parameter\""), "{message:?}");
    }
}

#[test]
fn entries_are_described_sorted_and_reject_unknown_parameters() {
    entries_are_sound(EXTRACTORS);
    entries_are_sound(DETECTORS);
    entries_are_sound(REFINERS);
}

// ---- Extractors -------------------------------------------------------------------------------

fn region(name: &str, extractor: &dyn TargetExtractor, exposure: &Exposure) -> TargetRegion {
    extractor.extract(exposure).unwrap_or_else(|none| panic!("{name}: {}", none.name()))
}

/// Whether the corners are the same to 1e-9 px, from whichever they start.
fn same_corners(found: &[ImagePoint; 4], expected: &[ImagePoint; 4]) -> bool {
    (0..4).any(|start| (0..4).all(|i| found[(start + i) % 4].distance_px(expected[i]) < 1e-9))
}

#[test]
fn extractors_are_deterministic_and_follow_a_shift_and_a_turn() {
    for (name, extractor) in built(EXTRACTORS) {
        let original = region(name, extractor.as_ref(), &scene(0, 0));
        assert!(original.pixels > 500, "{name}");

        let again = region(name, extractor.as_ref(), &scene(0, 0));
        assert_eq!(again.quadrilateral, original.quadrilateral, "{name}");
        assert_eq!(again.mask, original.mask, "{name}");

        let shifted = region(name, extractor.as_ref(), &scene(17, 9));
        let expected = original.quadrilateral.map(|corner| moved(corner, 17.0, 9.0));
        assert!(same_corners(&shifted.quadrilateral, &expected), "{name}: {shifted:?}");
        assert_eq!(shifted.pixels, original.pixels, "{name}");
        assert_eq!(
            (shifted.range.x0, shifted.range.y1),
            (original.range.x0 + 17, original.range.y1 + 9)
        );

        let turned = region(name, extractor.as_ref(), &turned(&scene(0, 0)));
        let expected = original.quadrilateral.map(|corner| turned_point(corner, &scene(0, 0)));
        assert!(same_corners(&turned.quadrilateral, &expected), "{name}: {turned:?}");
        assert_eq!(turned.pixels, original.pixels, "{name}");
    }
}

#[test]
fn extractors_answer_on_degenerate_images() {
    for (name, extractor) in built(EXTRACTORS) {
        for exposure in degenerate() {
            let Ok(region) = extractor.extract(&exposure) else { continue };
            assert!(region.pixels > 0, "{name}");
            assert_eq!(region.mask.width(), exposure.width(), "{name}");
            for corner in region.quadrilateral {
                assert!(corner.x.is_finite() && corner.y.is_finite(), "{name}: {corner:?}");
            }
        }
    }
}

// ---- Detectors --------------------------------------------------------------------------------

/// By row, then column.
fn by_place(mut detections: Vec<Detection>) -> Vec<Detection> {
    detections
        .sort_by(|a, b| a.point.y.total_cmp(&b.point.y).then(a.point.x.total_cmp(&b.point.x)));
    detections
}

/// Whether the same candidates were found to 1e-3 px, with responses to 1e-4 of their size, in
/// whichever order.
fn same_detections(found: Vec<Detection>, expected: Vec<Detection>) -> bool {
    found.len() == expected.len()
        && by_place(found).iter().zip(by_place(expected)).all(|(found, expected)| {
            found.point.distance_px(expected.point) < 1e-3
                && (found.response - expected.response).abs() <= 1e-4 * expected.response.abs()
        })
}

#[test]
fn detectors_are_deterministic_and_follow_a_shift_and_a_turn() {
    for (name, detector) in built(DETECTORS) {
        let detect = |exposure: &Exposure| detector.detect(exposure, None);
        let original = detect(&scene(0, 0));
        let least = match name {
            "chess" => 0, // a control: there is no X
            "susan" => 2, // the others' luma differs by less than counts
            _ => 3,
        };
        assert!(original.len() >= least, "{name}: {} of 5 corners", original.len());
        assert_eq!(detect(&scene(0, 0)), original, "{name}");

        let along = |detection: &Detection| Detection {
            point: moved(detection.point, 17.0, 9.0),
            ..*detection
        };
        let expected = original.iter().map(along).collect();
        assert!(same_detections(detect(&scene(17, 9)), expected), "{name}");

        let round = |detection: &Detection| Detection {
            point: turned_point(detection.point, &scene(0, 0)),
            ..*detection
        };
        let expected = original.iter().map(round).collect();
        assert!(same_detections(detect(&turned(&scene(0, 0))), expected), "{name}");

        let mirror = |detection: &Detection| Detection {
            point: ImagePoint::new(SIZE[0] as f64 - 1.0 - detection.point.x, detection.point.y),
            ..*detection
        };
        let expected: Vec<Detection> = original.iter().map(mirror).collect();
        let found = detect(&mirrored(&scene(0, 0)));
        if name == "line_junctions" {
            // Its segments grow with the brighter side to the right: in a mirror from the other end.
            let (found, expected) = (by_place(found), by_place(expected));
            assert_eq!(found.len(), expected.len(), "{name}");
            for (found, expected) in found.iter().zip(&expected) {
                assert!(found.point.distance_px(expected.point) < 0.05, "{found:?} {expected:?}");
                assert_eq!(found.junction, expected.junction);
            }
        } else {
            assert!(same_detections(found, expected), "{name}");
        }
    }
}

/// The same places, whatever the digital numbers of black and of white are; but for thresholds that are
/// digital numbers themselves.
#[test]
fn detectors_follow_gain_and_offset() {
    for (entry, (name, detector)) in DETECTORS.iter().zip(built(DETECTORS)) {
        let places = |detector: &dyn Detector, exposure: &Exposure| {
            by_place(detector.detect(exposure, None)).iter().map(|d| d.point).collect::<Vec<_>>()
        };
        // Luma is rounded: twice as bright it is not twice as much, unless it is grey.
        let coloured = scene(0, 0);
        let shaded = grey(coloured.rgb()[0].clone());
        let is_blind = detector.detect(&shaded, None).is_empty();
        let exposure = if is_blind { coloured } else { shaded };
        let original = places(detector.as_ref(), &exposure);
        let mut table = (entry.defaults)();
        if let Some(threshold) = table.get_mut("threshold") {
            *threshold = (2.0 * threshold.as_float().expect("a number")).into();
        }
        if let Some(brightness) = table.get_mut("brightness") {
            // Full scale is 511, not 510.
            *brightness = (510.0 / 511.0 * brightness.as_float().expect("a number")).into();
        }
        let amplifying = (entry.build)(name, &table).expect("in range");
        for offset_dn in [0.0, 24.0] {
            let found = places(amplifying.as_ref(), &amplified(&exposure, offset_dn));
            let others = |some: &[ImagePoint], all: &[ImagePoint]| {
                let is_there =
                    |point: &ImagePoint| all.iter().any(|o| o.distance_px(*point) < 1e-3);
                some.iter().filter(|point| !is_there(point)).count()
            };
            // Of susan full scale is the unit, and not doubled exactly: what lies on a limit may pass it.
            let most = usize::from(name == "susan");
            assert!(others(&found, &original) <= most, "{name}: {found:?} {original:?}");
            assert!(others(&original, &found) <= most, "{name}: {found:?} {original:?}");
        }
    }
}

#[test]
fn detectors_return_the_strongest_first() {
    for (name, detector) in built(DETECTORS) {
        for exposure in degenerate().into_iter().chain([scene(0, 0)]) {
            let found = detector.detect(&exposure, None);
            assert!(found.is_sorted_by(|a, b| a.response >= b.response), "{name}: {found:?}");
        }
    }
}

#[test]
fn detectors_answer_on_degenerate_images_and_regions() {
    let nowhere = TargetRegion {
        mask: Plane::filled(1, 1, false),
        range: cornerbench::image::PixelRange { x0: 0, y0: 0, x1: 0, y1: 0 },
        quadrilateral: [ImagePoint::new(f64::NAN, f64::NAN); 4],
        pixels: 0,
    };
    let far = TargetRegion {
        quadrilateral: [[900.0, 900.0], [1e30, 900.0], [1e30, 1e30], [900.0, 1e30]]
            .map(ImagePoint::from),
        ..nowhere.clone()
    };
    for (name, detector) in built(DETECTORS) {
        for exposure in degenerate().into_iter().chain([scene(0, 0)]) {
            for detection in detector.detect(&exposure, None) {
                let Detection { point, response, .. } = detection;
                assert!(
                    point.x.is_finite() && point.y.is_finite() && response.is_finite(),
                    "{name}"
                );
            }
            assert!(detector.detect(&exposure, Some(&nowhere)).is_empty(), "{name}");
            assert!(detector.detect(&exposure, Some(&far)).is_empty(), "{name}");
        }
        let flat = detector.detect(&degenerate()[1], None);
        assert!(flat.is_empty(), "{name} found corners where there is nothing: {flat:?}");
    }
}

// ---- Refiners ---------------------------------------------------------------------------------

/// Whether the answers agree: the same status and, to 1e-3 px, the same position; to a fiftieth of its size the same
/// covariance.
fn same_corner(found: &Corner, expected: &Corner) -> bool {
    let same_covariance = match (found.covariance_px2, expected.covariance_px2) {
        (Some(found), Some(expected)) => (found - expected).norm() < 0.02 * expected.norm(),
        (found, expected) => found == expected,
    };
    found.status == expected.status
        && found.position.distance_px(expected.position) < 1e-3
        && same_covariance
}

/// Refiners that answer none of the drawn corners: one knows X corners alone, one wants a whole cuboid.
const ELSEWHERE: [&str; 2] = ["cuboid_fit", "saddle_polynomial"];

#[test]
fn refiners_are_deterministic_and_follow_a_shift_and_a_turn() {
    for (name, refiner) in built(REFINERS) {
        let original = refiner.refine(&scene(0, 0), &vertex_seeds());
        assert_eq!(refiner.refine(&scene(0, 0), &vertex_seeds()), original, "{name}");
        let answered = original.iter().filter(|corner| corner.status.answered()).count();
        assert!(answered >= 3 || ELSEWHERE.contains(&name), "{name}: {original:?}");

        let turn = Matrix2::new(0.0, -1.0, 1.0, 0.0);
        let follows = |exposure: &Exposure, is_turned, along: &dyn Fn(ImagePoint) -> ImagePoint| {
            let seeds: Vec<Detection> = vertex_seeds()
                .iter()
                .map(|seed| Detection { point: along(seed.point), ..*seed })
                .collect();
            for (found, before) in refiner.refine(exposure, &seeds).iter().zip(&original) {
                let turned = |covariance| {
                    if is_turned { turn * covariance * turn.transpose() } else { covariance }
                };
                let expected = Corner {
                    position: along(before.position),
                    covariance_px2: before.covariance_px2.map(turned),
                    ..*before
                };
                assert!(same_corner(found, &expected), "{name}: {found:?} {expected:?}");
            }
        };
        follows(&scene(17, 9), false, &|point| moved(point, 17.0, 9.0));
        follows(&turned(&scene(0, 0)), true, &|point| turned_point(point, &scene(0, 0)));
    }
}

#[test]
fn no_refiner_but_none_locates_a_corner_where_there_is_none() {
    let step = |far: f64| 40.0 + 170.0 * (0.5 + 0.5 * (1.6 * far).tanh());
    let images = [
        ("flat", Plane::filled(64, 64, 120.0)),
        ("ramp", Plane::from_fn(64, 64, |x, y| (2.0 * x as f32 + y as f32).round())),
        ("edge", Plane::from_fn(64, 64, |x, _| step(x as f64 - 31.3).round() as f32)),
        (
            "edge aslant",
            Plane::from_fn(64, 64, |x, y| {
                step(0.8 * (x as f64 - 31.3) + 0.6 * (y as f64 - 30.2)).round() as f32
            }),
        ),
    ];
    for (name, refiner) in built(REFINERS).filter(|(name, _)| *name != "none") {
        for (what, image) in &images {
            let seeds = [seed(31.0, 30.0), seed(32.4, 31.7), seed(29.0, 33.0)];
            for corner in refiner.refine(&grey(image.clone()), &seeds) {
                assert!(!corner.status.answered(), "{name}, {what}: {corner:?}");
            }
        }
    }
}

#[test]
fn refiners_allocate_nothing_for_one_corner_more() {
    for (name, refiner) in built(REFINERS) {
        if name == "cuboid_fit" {
            continue; // it makes one cuboid of all corners
        }
        let exposure = scene(0, 0);
        exposure.luma();
        let of = |count: usize| {
            let seeds: Vec<Detection> =
                vertex_seeds().into_iter().cycle().take(5 * count).collect();
            refiner.refine(&exposure, &seeds);
            allocation_counter::measure(|| drop(refiner.refine(&exposure, &seeds))).count_total
        };
        let (few, many) = (of(2), of(8));
        assert!(many <= few + 3, "{name}: {few} for 10 corners, {many} for 40");
    }
}

/// The bits of a point, so that NaN equals itself.
fn bits(point: ImagePoint) -> [u64; 2] {
    [point.x.to_bits(), point.y.to_bits()]
}

#[test]
fn refiners_answer_each_seed_with_a_finite_position_or_decline_it() {
    let (nan, infinity) = (f64::NAN, f64::INFINITY);
    let mut seeds = vertex_seeds();
    seeds.extend(
        [(nan, 5.0), (5.0, nan), (infinity, 5.0), (5.0, -infinity)].map(|(x, y)| seed(x, y)),
    );
    seeds.extend([(-4.0, 5.0), (1e30, 5.0), (0.0, 0.0), (63.9, 47.9)].map(|(x, y)| seed(x, y)));
    for (name, refiner) in built(REFINERS) {
        for exposure in degenerate().into_iter().chain([scene(0, 0)]) {
            let corners = refiner.refine(&exposure, &seeds);
            assert_eq!(corners.len(), seeds.len(), "{name}");
            for (corner, seed) in corners.iter().zip(&seeds) {
                assert_eq!(bits(corner.seed.point), bits(seed.point), "{name}");
                let Corner { position, status, .. } = corner;
                if let Some(covariance) = corner.covariance_px2 {
                    let is_one = covariance.determinant() >= 0.0 && covariance.trace() > 0.0;
                    assert!(status.answered() && is_one, "{name}: {corner:?}");
                }
                if status.answered() {
                    assert!(position.x.is_finite() && position.y.is_finite(), "{name}: {corner:?}");
                } else {
                    assert_eq!(bits(*position), bits(seed.point), "{name}: {corner:?}");
                }
            }
            assert!(refiner.refine(&exposure, &[]).is_empty(), "{name}");
        }
    }
}

#[test]
fn the_order_of_seeds_does_not_change_the_answers() {
    for (name, refiner) in built(REFINERS) {
        let mut seeds = vertex_seeds();
        let mut expected = refiner.refine(&scene(0, 0), &seeds);
        seeds.reverse();
        expected.reverse();
        assert_eq!(refiner.refine(&scene(0, 0), &seeds), expected, "{name}");
    }
}
