//! Our detectors beside those of OpenCV, scikit-image and kornia: the same pictures, one core, in turns,
//! and whether the answers agree.
//!
//! Ours keep their memory from call to call, as they do in a run; so do OpenCV's responses. The others
//! have no way to. On a busy machine believe the ratio of the least times: long calls are interrupted
//! more often than short ones.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use comfy_table::{Table, presets};
use cornerbench::cli::environment::{Purpose, present_python};
use cornerbench::detect::fast::Fast;
use cornerbench::detect::foerstner::Foerstner;
use cornerbench::detect::good_features::GoodFeatures;
use cornerbench::detect::harris::Harris;
use cornerbench::detect::hessian_determinant::HessianDeterminant;
use cornerbench::detect::kitchen_rosenfeld::KitchenRosenfeld;
use cornerbench::detect::noble::Noble;
use cornerbench::detect::rohr::Rohr;
use cornerbench::detect::shi_tomasi::ShiTomasi;
use cornerbench::detect::tensor::{Derivative, Measure, StructureTensor};
use cornerbench::detect::{Detection, Detector, Peaks, Scratch};
use cornerbench::image::Plane;
use cornerbench::sensor::Exposure;
use serde::Deserialize;

use super::detect::{MeasuredTensor, box_tensor};
use super::photograph::{of_grey, photograph, texture};
use super::turns::{Spread, Times, pool};

const ROUNDS: usize = 5;
const REPEATS: usize = 11;

/// The Python that has the peers: what the environment variable `PYTHON` names, or one that
/// `cornerbench setup` has set up. Where there is none it says so.
pub fn python() -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let set_up = || {
        let present = |purpose| present_python(root, purpose).expect("a lock");
        present(Purpose::Kornia).or_else(|| present(Purpose::Peers))
    };
    let found = std::env::var_os("PYTHON").map(PathBuf::from).or_else(set_up);
    if found.is_none() {
        println!("peers: none is set up; run cornerbench setup --peers to have them beside ours");
    }
    found
}

/// Something that we and a library do.
struct Comparison {
    what: &'static str,
    library: &'static str,
    /// What the library's script calls it.
    theirs: &'static str,
    ours: Ours,
    agreement: Agreement,
}

enum Ours {
    Response(Box<Respond>),
    Points(Box<dyn Detector>),
}

type Respond = dyn FnMut(&Exposure, &mut Plane<f32>) + Send;

/// How far answers have to be the same.
#[derive(Clone, Copy)]
enum Agreement {
    /// Responses differ by no more than `tolerance` of the largest, so far from the border and farther.
    Response { margin_px: usize, tolerance: f32 },
    /// Points are the same, so far from the border and farther, in any order.
    Points { margin_px: usize },
    /// Derivatives are others: of our 100 strongest points at least this many have one of theirs within
    /// 2 px. Of pixels at random four in ten have, at most.
    Near { least: usize },
}

fn response(tensor: StructureTensor, measure: impl Measure + Send + 'static) -> Ours {
    let mut tensor = MeasuredTensor::new(&tensor);
    Ours::Response(Box::new(move |exposure, out| tensor.respond(exposure, &measure, out)))
}

/// What is compared, and how far it agrees. Sums in single precision differ by their order: responses, by
/// less than a hundred thousandth of the largest.
fn comparisons() -> Vec<Comparison> {
    const ROUNDING: f32 = 1e-5;
    let everywhere = Agreement::Response { margin_px: 0, tolerance: ROUNDING };
    let opencv = [
        ("Harris response, box", "harris", response(box_tensor(), Harris::default()), everywhere),
        (
            "smaller eigenvalue, box",
            "min_eigenvalue",
            response(box_tensor(), ShiTomasi::default()),
            everywhere,
        ),
        (
            "Harris response, Gaussian",
            "gaussian_harris",
            response(StructureTensor::default(), Harris::default()),
            everywhere,
        ),
        (
            "good features to track",
            "good_features",
            Ours::Points(Box::new(GoodFeatures::default())),
            Agreement::Points { margin_px: 0 },
        ),
        (
            "FAST-9",
            "fast",
            Ours::Points(Box::new(Fast::default())),
            Agreement::Points { margin_px: 0 },
        ),
    ];

    // Sobel's slopes and a window of 11 samples, as scikit-image's is at this scale. It continues image
    // and products with zeros: so near to the border, 1 px of the slope and 5 px of the window, it
    // differs.
    let tensor = || StructureTensor {
        derivative: Derivative::Sobel,
        sigma_i: 1.35,
        ..StructureTensor::default()
    };
    let inside = Agreement::Response { margin_px: 6, tolerance: ROUNDING };
    let fast = Fast::default();
    let least = |peaks: Peaks| Peaks { threshold: 1e4, threshold_rel: 0.0, ..peaks };
    let scikit_image = [
        ("Harris response", "harris", response(tensor(), Harris::default()), inside),
        ("Rohr response", "rohr", response(tensor(), Rohr::default()), inside),
        ("Noble response", "noble", response(tensor(), Noble::default()), inside),
        ("Shi-Tomasi response", "shi_tomasi", response(tensor(), ShiTomasi::default()), inside),
        (
            "Foerstner's precision",
            "foerstner",
            response(tensor(), Foerstner { roundness: 0.0, ..Foerstner::default() }),
            inside,
        ),
        (
            "FAST-9, before suppression",
            "fast",
            Ours::Response(Box::new(move |exposure, out| {
                let threshold = 20.0;
                fast.score(exposure.luma().view(), threshold, out);
                out.samples_mut().iter_mut().for_each(|s| *s = f32::from(*s > threshold));
            })),
            // Whole numbers: nothing to round.
            Agreement::Response { margin_px: 0, tolerance: 0.0 },
        ),
        (
            "Harris corners",
            "harris_peaks",
            Ours::Points(Box::new(Harris {
                tensor: tensor(),
                peaks: least(Peaks::default()),
                ..Harris::default()
            })),
            // The maximum of 2 px on each side of those that agree.
            Agreement::Points { margin_px: 8 },
        ),
        (
            "Kitchen-Rosenfeld corners",
            "kitchen_rosenfeld_peaks",
            Ours::Points(Box::new(KitchenRosenfeld {
                peaks: Peaks { threshold_rel: 0.3, ..Peaks::default() },
                ..KitchenRosenfeld::default()
            })),
            Agreement::Near { least: 90 },
        ),
    ];

    // kornia's window is of 1 px; it reflects the products at the border, where we replicate them.
    let tensor = || StructureTensor { sigma_i: 1.0, ..tensor() };
    let inside = Agreement::Response { margin_px: 3, tolerance: ROUNDING };
    let kornia = [
        ("Harris response", "harris", response(tensor(), Harris::default()), inside),
        ("Shi-Tomasi response", "shi_tomasi", response(tensor(), ShiTomasi::default()), inside),
        (
            "corners of the Hessian's determinant",
            "hessian_peaks",
            Ours::Points(Box::new(HessianDeterminant::default())),
            Agreement::Near { least: 90 },
        ),
    ];
    let of = |library| {
        move |(what, theirs, ours, agreement)| Comparison { what, library, theirs, ours, agreement }
    };
    let all = opencv.into_iter().map(of("opencv"));
    let all = all.chain(scikit_image.into_iter().map(of("scikit_image")));
    all.chain(kornia.into_iter().map(of("kornia"))).collect()
}

/// What a library's script says.
#[derive(Deserialize)]
struct Said {
    version: String,
    points: BTreeMap<String, Vec<Vec<f64>>>,
    took_s: BTreeMap<String, TookS>,
}

#[derive(Deserialize)]
pub struct TookS {
    pub least: f64,
    pub median: f64,
}

/// A picture, its file, and the folder for a library's responses to it.
struct Picture {
    name: &'static str,
    exposure: Exposure,
    folder: tempfile::TempDir,
}

impl Picture {
    /// Of the exposure's luma alone, which thereby is the same to everybody.
    fn new(name: &'static str, exposure: &Exposure) -> Self {
        let exposure = of_grey(exposure.luma().clone());
        let folder = tempfile::tempdir().expect("a folder");
        exposure.to_picture().save(folder.path().join("luma.png")).expect("written");
        Self { name, exposure, folder }
    }

    fn size(&self) -> [usize; 2] {
        [self.exposure.width(), self.exposure.height()]
    }

    /// What a library makes of it; `None` where that is not installed.
    fn ask(&self, python: &Path, library: &str) -> Option<Said> {
        const NOT_INSTALLED: i32 = 3;
        let output = Command::new(python)
            .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/tests/peers/detectors.py"))
            .arg(library)
            .args([&self.folder.path().join("luma.png"), self.folder.path()])
            .arg(REPEATS.to_string())
            .envs(["OMP", "MKL", "OPENBLAS"].map(|of| (format!("{of}_NUM_THREADS"), "1")))
            .output()
            .expect("Python");
        if output.status.code() == Some(NOT_INSTALLED) {
            return None;
        }
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{library}: {error}");
        Some(serde_json::from_slice(&output.stdout).expect("JSON"))
    }

    /// A response that a library has written.
    fn response(&self, name: &str) -> Plane<f32> {
        let bytes = std::fs::read(self.folder.path().join(format!("{name}.f32"))).expect("written");
        let sample = |four: &[u8]| f32::from_le_bytes(four.try_into().expect("four bytes"));
        let [width, height] = self.size();
        Plane::from_samples(width, height, bytes.chunks_exact(4).map(sample).collect())
    }
}

/// Our memory, and the last answer.
struct Answer {
    scratch: Scratch,
    found: Vec<Detection>,
    response: Plane<f32>,
}

impl Answer {
    fn to(&mut self, ours: &mut Ours, exposure: &Exposure) {
        match ours {
            Ours::Response(respond) => respond(exposure, &mut self.response),
            Ours::Points(detector) => {
                detector.detect_into(exposure, None, &mut self.scratch, &mut self.found);
            }
        }
    }
}

/// A comparison's line, round after round.
#[derive(Default)]
struct Line {
    ours: Vec<Times>,
    theirs: Vec<Times>,
    agreement: String,
}

impl Line {
    /// The median of the rounds' medians and the least time of all \[ms\].
    fn ms(rounds: &[Times]) -> String {
        let median = Spread::of(rounds.iter().map(|times| times.median_s).collect()).middle;
        format!("{:.3} ({:.3})", 1e3 * median, 1e3 * Self::least_s(rounds))
    }

    fn least_s(rounds: &[Times]) -> f64 {
        rounds.iter().map(|times| times.least_s).fold(f64::INFINITY, f64::min)
    }

    fn cells(&self, comparison: &Comparison, picture: &Picture) -> Vec<String> {
        let [width, height] = picture.size();
        let rounds = self.theirs.iter().zip(&self.ours);
        let ratios = rounds.map(|(theirs, ours)| theirs.median_s / ours.median_s);
        let ratio = Spread::of(ratios.collect());
        let least = Self::least_s(&self.theirs) / Self::least_s(&self.ours);
        let digits = if ratio.least.min(least) < 1.0 { 2 } else { 1 };
        vec![
            comparison.what.to_owned(),
            format!("{} {width}x{height}", picture.name),
            Self::ms(&self.ours),
            comparison.library.replace('_', "-"),
            Self::ms(&self.theirs),
            format!("{ratio:.digits$}"),
            format!("{least:.digits$}"),
            self.agreement.clone(),
        ]
    }
}

/// Prints how long we and the libraries take for the same, on one core, in turns.
///
/// # Panics
/// After that, when an answer differs.
pub fn compare() {
    let Some(python) = python() else { return };
    let pictures =
        [Picture::new("photograph", &photograph()), Picture::new("texture", &texture(640, 480))];
    let mut comparisons = comparisons();
    let mut lines: BTreeMap<(usize, usize), Line> = BTreeMap::new();
    let mut differing = Vec::new();
    let mut libraries = vec!["opencv", "scikit_image", "kornia"];
    let one = pool(1);
    for round in 0..ROUNDS {
        for (number, picture) in pictures.iter().enumerate() {
            let [width, height] = picture.size();
            let mut answer = Answer {
                scratch: Scratch::default(),
                found: Vec::new(),
                response: Plane::filled(width, height, 0.0),
            };
            libraries.retain(|&library| {
                let Some(said) = picture.ask(&python, library) else {
                    println!("{library} is not installed; run cornerbench setup --kornia");
                    return false;
                };
                if (round, number) == (0, 0) {
                    println!("{library} {}", said.version);
                }
                let of_library = comparisons.iter_mut().enumerate();
                for (index, comparison) in of_library.filter(|(_, c)| c.library == library) {
                    let ours = &mut comparison.ours;
                    let exposure = &picture.exposure;
                    answer.to(ours, exposure);
                    let times = one.install(|| Times::of(REPEATS, || answer.to(ours, exposure)));
                    let line = lines.entry((number, index)).or_default();
                    let TookS { least, median } = said.took_s[comparison.theirs];
                    line.ours.push(times);
                    line.theirs.push(Times { least_s: least, median_s: median });
                    if round == 0 {
                        let agrees = agreement(comparison, picture, &answer, &said);
                        line.agreement = agrees.unwrap_or_else(|difference| {
                            differing.push(format!("{}: {difference}", comparison.what));
                            format!("NO: {difference}")
                        });
                    }
                }
                true
            });
        }
    }
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header([
        "what",
        "picture",
        "ours [ms]",
        "library",
        "theirs [ms]",
        "theirs / ours",
        "of the least",
        "answers",
    ]);
    for ((number, index), line) in &lines {
        table.add_row(line.cells(&comparisons[*index], &pictures[*number]));
    }
    println!("{table}");
    println!(
        "One core each, {ROUNDS} rounds in turns of {REPEATS} calls: median of the rounds' medians (least \
         of all calls); ratio of the medians, its least and most of the rounds; ratio of the least times."
    );
    assert!(differing.is_empty(), "answers differ: {differing:#?}");
}

/// How far the answers agree; an error where that is less than they have to.
fn agreement(
    comparison: &Comparison,
    picture: &Picture,
    ours: &Answer,
    said: &Said,
) -> Result<String, String> {
    let [width, height] = picture.size();
    let judged = |agrees, text: String| if agrees { Ok(text) } else { Err(text) };
    let found = ours.found.iter().map(|found| [found.point.x, found.point.y]);
    let theirs = || said.points[comparison.theirs].iter().map(|point| [point[0], point[1]]);
    match comparison.agreement {
        Agreement::Response { margin_px, tolerance } => {
            let theirs = picture.response(comparison.theirs);
            let (mut largest, mut difference) = (0.0_f32, 0.0_f32);
            for y in margin_px..height - margin_px {
                for x in margin_px..width - margin_px {
                    largest = largest.max(theirs.at(x, y).abs());
                    difference = difference.max((ours.response.at(x, y) - theirs.at(x, y)).abs());
                }
            }
            // Not a number, and no agreement, where a response is 0 everywhere.
            let relative = difference / largest;
            judged(relative <= tolerance, format!("to {relative:.0e} of the largest"))
        }
        Agreement::Points { margin_px } => {
            let inside = |[x, y]: &[f64; 2]| {
                let margin = margin_px as f64;
                let within = |value: f64, size: usize| {
                    value >= margin && value <= (size - 1) as f64 - margin
                };
                within(*x, width) && within(*y, height)
            };
            let sorted = |points: &mut dyn Iterator<Item = [f64; 2]>| {
                let mut points: Vec<_> = points.filter(inside).collect();
                points.sort_by(|a, b| a[1].total_cmp(&b[1]).then(a[0].total_cmp(&b[0])));
                points
            };
            let (found, theirs) = (sorted(&mut found.clone()), sorted(&mut theirs()));
            let same = found.iter().filter(|point| theirs.contains(point)).count();
            let counts = format!("{same} alike of our {}, their {}", found.len(), theirs.len());
            judged(found == theirs && same > 0, counts)
        }
        Agreement::Near { least } => {
            let strongest: Vec<_> = found.take(100).collect();
            let is_near = |[x, y]: &&[f64; 2]| theirs().any(|[u, v]| (u - x).hypot(v - y) <= 2.0);
            let near = strongest.iter().filter(is_near).count();
            let counts = format!("{near} of {} near their {}", strongest.len(), theirs().len());
            judged(near >= least, counts)
        }
    }
}
