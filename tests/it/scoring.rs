//! What answers count as, against the truth of a rendered cuboid.

use cornerbench::bound::{CornerBounds, Seeing, corner_bounds};
use cornerbench::detect::Detection;
use cornerbench::geometry::ImagePoint;
use cornerbench::metrics::{CornerRule, CornerScores, Fate, Place, Seen, score_corners};
use cornerbench::plan::read_camera;
use cornerbench::refine::{Corner, RefineStatus};
use cornerbench::scene::{Cause, Dataset, FalseJunction, Scene, Truth, Visibility};
use cornerbench::sensor::Rig;

use crate::support::{cornerbench, plain_dataset, project, recipes, run, stderr, succeed};

const RULE: CornerRule = CornerRule { gate_px: 5.0, least_edge_px: 3.0, most_bound_px: 0.5 };

/// The cuboid from obliquely above: seven corners, far from each other.
fn scene() -> Scene {
    Dataset::open(plain_dataset()).expect("the dataset").read("oblique").expect("the scene")
}

/// An answer of this response.
fn answer(point: ImagePoint, response: f64) -> Corner {
    Corner::at_seed(Detection::new(point, response), 0, RefineStatus::Ok)
}

fn score(scene: &Scene, truth: &Truth, rule: CornerRule, answers: &[Corner]) -> CornerScores {
    let camera = scene.description.camera;
    let rig =
        Rig { camera, world_from_camera: scene.description.world_from_camera, object_size_m: None };
    let bound = CornerBounds { closed_px: Some(0.02), ..CornerBounds::default() };
    let bounds = vec![bound; truth.corners.len()];
    score_corners(&Seen::new(scene, truth, bounds, &rig), answers, rule)
}

fn places(scores: &CornerScores) -> Vec<Place> {
    scores.others.iter().map(|other| other.place).collect()
}

fn moved(point: ImagePoint, x_px: f64) -> ImagePoint {
    ImagePoint::new(point.x + x_px, point.y)
}

fn visible(truth: &Truth) -> Vec<ImagePoint> {
    let seen = truth.corners.iter().filter(|corner| corner.visibility == Visibility::Visible);
    seen.map(|corner| corner.image_point_px).collect()
}

#[test]
fn answers_at_the_visible_corners_find_them_all_and_nothing_else() {
    let scene = scene();
    let points = visible(&scene.truth);
    let answers: Vec<_> = points.iter().map(|point| answer(moved(*point, 0.25), 7.0)).collect();
    let scores = score(&scene, &scene.truth, RULE, &answers);
    assert!(scores.others.is_empty(), "{scores:?}");
    for (corner, score) in scene.truth.corners.iter().zip(&scores.corners) {
        if corner.visibility == Visibility::Visible {
            assert_eq!((score.fate, score.found_at_response), (Fate::Found, Some(7.0)));
            assert!((score.detected_error_px.expect("found") - 0.25).abs() < 1e-9);
        } else {
            assert_eq!((score.fate, score.answer), (Fate::Hidden, None));
        }
    }
}

#[test]
fn of_two_answers_the_nearer_is_matched_and_the_stronger_says_when_it_is_found() {
    let scene = scene();
    let point = visible(&scene.truth)[0];
    let answers = [answer(moved(point, 1.0), 3.0), answer(moved(point, -2.0), 8.0)];
    let scores = score(&scene, &scene.truth, RULE, &answers);
    let found: Vec<_> = scores.corners.iter().filter(|one| one.fate == Fate::Found).collect();
    assert_eq!(found.len(), 1);
    assert_eq!((found[0].answer, found[0].found_at_response), (Some(0), Some(8.0)));
    assert_eq!(places(&scores), [Place::Duplicate]);
    assert!((scores.others[0].nearest_corner_px.expect("one") - 2.0).abs() < 1e-9);
}

#[test]
fn answers_where_no_corner_is_say_what_is_there() {
    let scene = scene();
    let truth = &scene.truth;
    let edge = truth.edges.iter().find(|edge| edge.visible_fraction > 0.9).expect("an edge");
    let [from, to] = edge.corners.map(|corner| truth.corners[corner].image_point_px);
    let middle = ImagePoint::new(0.5 * (from.x + to.x), 0.5 * (from.y + to.y));
    let face = truth.faces.iter().find(|face| face.facing).expect("a face").centre_image_point_px;
    // Four pixels beside the edge's middle is within the gate of it, 5.5 are not.
    let length = from.distance_px(to);
    let across = [-(to.y - from.y) / length, (to.x - from.x) / length];
    let beside = |by: f64| ImagePoint::new(middle.x + by * across[0], middle.y + by * across[1]);
    let answers = [middle, beside(4.0), face, ImagePoint::new(3.0, 3.0)].map(|p| answer(p, 1.0));
    let scores = score(&scene, truth, RULE, &answers);
    assert_eq!(places(&scores), [Place::Edge, Place::Edge, Place::Target, Place::Background]);
    let narrow = CornerRule { gate_px: 3.5, ..RULE };
    let scores = score(&scene, truth, narrow, &answers[1..2]);
    assert!(matches!(places(&scores)[..], [Place::Target | Place::Background]), "{scores:?}");
}

#[test]
fn corners_that_cannot_be_asked_for_are_not_and_answers_there_are_ignored() {
    let scene = scene();
    let answers: Vec<_> = visible(&scene.truth).iter().map(|p| answer(*p, 1.0)).collect();
    for (rule, fate, place) in [
        (CornerRule { least_edge_px: 500.0, ..RULE }, Fate::TooSmall, Place::SmallCorner),
        (CornerRule { most_bound_px: 0.01, ..RULE }, Fate::TooUncertain, Place::UncertainCorner),
    ] {
        let scores = score(&scene, &scene.truth, rule, &answers);
        let fates: Vec<_> = scores.corners.iter().map(|one| one.fate).collect();
        assert_eq!(fates.iter().filter(|one| **one == fate).count(), answers.len());
        assert_eq!(places(&scores), vec![place; answers.len()]);
        assert!(place.is_ignored());
    }
}

#[test]
fn the_nearest_of_what_is_known_says_what_an_answer_is() {
    let scene = scene();
    let mut truth = scene.truth.clone();
    let hidden = visible(&truth)[0];
    let corner = truth.corners.iter_mut().find(|corner| corner.image_point_px == hidden);
    corner.expect("the corner").visibility = Visibility::Occluded;
    truth.false_junctions = vec![FalseJunction {
        cause: Cause::T,
        name: "an outline".into(),
        image_point_px: moved(hidden, 4.0),
        position_m: [0.0; 3],
        object_id: None,
        edge: None,
    }];
    let at = |by_px: f64, response| answer(moved(hidden, by_px), response);
    let scores = score(&scene, &truth, RULE, &[at(0.5, 9.0), at(3.0, 1.0), at(4.5, 2.0)]);
    let t = Place::FalseJunction(Cause::T);
    assert_eq!(places(&scores), [Place::HiddenCorner, t, t]);
    assert_eq!(scores.false_junctions, [Some(2.0)]);
}

#[test]
fn an_answer_near_a_corner_asked_for_is_never_ignored() {
    let scene = scene();
    let mut truth = scene.truth.clone();
    let points = visible(&truth);
    let hidden = truth.corners.iter_mut().find(|corner| corner.image_point_px == points[1]);
    let hidden = hidden.expect("the corner");
    (hidden.visibility, hidden.image_point_px) = (Visibility::Occluded, moved(points[0], 4.0));
    let answers = [answer(points[0], 5.0), answer(moved(points[0], 3.5), 9.0)];
    assert_eq!(places(&score(&scene, &truth, RULE, &answers)), [Place::Duplicate]);
    let beyond = [answer(moved(points[0], 6.0), 9.0)];
    assert_eq!(places(&score(&scene, &truth, RULE, &beyond)), [Place::HiddenCorner]);
}

/// The bounds of the scene's corners in a camera's photograph.
fn bounds(scene: &Scene, name: &str) -> Vec<CornerBounds> {
    let photographer = read_camera(&project().join("scenes"), name).expect("a camera");
    let film_camera = scene.description.camera;
    let photograph =
        photographer.take(&scene.film, &film_camera, [0.0, 0.0], &["bound"]).expect("taken");
    let world_from_camera = scene.description.world_from_camera;
    let rig = Rig { camera: photograph.camera, world_from_camera, object_size_m: None };
    let exposure = photographer.noise_free(&photograph);
    let colour = photographer.model().colour;
    let seeing = Seeing { exposure: &exposure, colour, blur_px: photograph.blur_px };
    corner_bounds(&scene.truth, &rig, &seeing)
}

#[test]
fn a_corner_s_bounds_grow_with_the_camera_s_noise() {
    let scene = scene();
    let medians = ["ideal", "industrial-mono", "dim"].map(|name| {
        let mut seen: Vec<f64> = Vec::new();
        for (corner, bounds) in scene.truth.corners.iter().zip(bounds(&scene, name)) {
            assert!(corner.junction.is_some() || bounds == CornerBounds::default(), "{name}");
            seen.extend(bounds.closed_px);
        }
        assert!(seen.len() >= 5, "{name}: {seen:?}");
        seen.sort_by(f64::total_cmp);
        seen[seen.len() / 2]
    });
    // Rounding to 8 bits; a good sensor well lit; a fiftieth of that light.
    assert!(medians[0] > 1e-4 && medians[0] < medians[1], "{medians:?}");
    assert!(medians[1] < 0.1 && 3.0 * medians[1] < medians[2], "{medians:?}");
}

#[test]
fn what_more_is_used_makes_a_bound_smaller() {
    let scene = scene();
    let mut seen = 0;
    for (corner, bounds) in scene.truth.corners.iter().zip(bounds(&scene, "industrial-mono")) {
        let CornerBounds { closed_px, local_px: [r5, r10, r15], edges_px, object_px } = bounds;
        let (Some(closed), Some(edges), Some(object)) = (closed_px, edges_px, object_px) else {
            continue;
        };
        let local = [r5, r10, r15].map(|bound| bound.expect("pixels about a corner that is seen"));
        assert!(local[0] > 1.2 * local[1] && local[1] > 1.05 * local[2], "{bounds:?}");
        assert!(closed > 1.2 * edges && edges > 1.2 * object, "{bounds:?}");
        // With ramps unknown, and of a disc; in closed form without either.
        let ratio = local[1] / closed;
        assert!((0.8..4.0).contains(&ratio), "{:?}: {bounds:?}", corner.junction);
        seen += 1;
    }
    assert_eq!(seen, 7);
}

/// Measures the plain suite by a plan of its own; the summary, and the run's folder.
fn measured(plan: &str) -> (serde_json::Value, tempfile::TempDir) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let own = folder.path().join("recipes");
    crate::support::copy_folder(&recipes(), &own);
    std::fs::write(own.join("plans/own.toml"), plan).expect("written");
    let text = succeed(
        cornerbench()
            .args(["measure", "own", "--json", "--recipes"])
            .args([&own, plain_dataset()])
            .arg("-o")
            .arg(folder.path().join("run")),
    );
    (serde_json::from_str(&text).expect("JSON"), folder)
}

#[test]
fn a_plan_may_end_with_corners_of_the_region_or_of_the_whole_image() {
    let (summary, folder) = measured(
        "[[pipelines]]\nname = \"region\"\ntarget.algorithm = \"red_difference\"\n\
         detect = { algorithm = \"shi_tomasi\", threshold_rel = 1e-4 }\n\
         [[pipelines]]\nname = \"image\"\n\
         detect = { algorithm = \"shi_tomasi\", threshold_rel = 1e-4 }\n",
    );
    let methods = summary["methods"].as_array().expect("methods");
    let answers = |index: usize| methods[index]["detection"]["answers"].as_u64().expect("a count");
    assert!(answers(1) > answers(0), "{} and {}", answers(0), answers(1));
    for method in methods {
        assert!(method["grasps"].is_null());
        let detection = &method["detection"];
        let by_junction = &detection["recall_by"][0]["strata"];
        let asked: u64 = by_junction
            .as_array()
            .expect("strata")
            .iter()
            .map(|stratum| stratum["asked"].as_u64().expect("a count"))
            .sum();
        assert_eq!(Some(asked), detection["asked"].as_u64());
        for sweep in detection["sweeps"].as_array().expect("sweeps") {
            let area = sweep["average_precision"].as_f64().expect("a number");
            assert!((0.0..=1.0).contains(&area) && area > 0.0, "{sweep}");
            let curve = sweep["curve"].as_array().expect("a curve");
            let recall = |point: &serde_json::Value| point["recall"].as_f64().expect("a share");
            assert!(curve.windows(2).all(|pair| recall(&pair[0]) <= recall(&pair[1])));
        }
    }
    let page =
        std::fs::read_to_string(folder.path().join("run/report/index.html")).expect("a page");
    assert!(page.contains("precision-recall.svg") && !page.contains("Table 1, with truth"));
    let records = cornerbench::record::read_records(&folder.path().join("run/records.parquet"));
    let of_image = |record: &&cornerbench::record::Record| record.method == "image";
    for record in records.expect("records").iter().filter(of_image) {
        assert_eq!((&record.target_extractor, &record.face_selector), (&None, &None));
    }
}

#[test]
fn half_a_way_to_a_grasp_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    crate::support::copy_folder(&recipes(), folder.path());
    let file = folder.path().join("plans/plain.toml");
    let plan = std::fs::read_to_string(&file).expect("the plan");
    for (from, to, words) in [
        (
            "[pipelines.grasp]\nalgorithm = \"cell_at_corner_mean\"\nlookup = \"cell\"\n",
            "",
            "there is `face` but no `grasp`",
        ),
        ("[pipelines.face]\nalgorithm = \"least_occluded\"\n", "", "`grasp` but no `face`"),
        (
            "[pipelines.target]\nalgorithm = \"red_difference\"\ndiff_r = 100.0\n",
            "",
            "there is no `target`",
        ),
    ] {
        assert!(plan.contains(from), "{from}");
        std::fs::write(&file, plan.replace(from, to)).expect("written");
        let output = run(cornerbench()
            .args(["measure", "plain", "--recipes"])
            .args([folder.path(), plain_dataset()])
            .arg("-o")
            .arg(folder.path().join("run")));
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(words), "{}", stderr(&output));
    }
}
