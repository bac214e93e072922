//! Records -> how far methods agree on pictures whose corners nobody knows, and what known corners look as if counted from.

use std::collections::{BTreeMap, HashMap};

use serde::Serialize;
use serde_json::Value;

use crate::geometry::Origin;
use crate::record::{Record, RunDescription, status};
use crate::report::refinement::{is_answered, is_given};
use crate::report::words::Words;
use crate::stats::root_mean_square;

/// Methods that were given the same seeds, those of one detector with one set of parameters.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// Detector and version; target extractor before it, if there is one.
    pub seeds: String,
    /// The methods.
    pub methods: Vec<Agreeing>,
    /// Any two of them, the nearest to each other first.
    pub pairs: Vec<Pair>,
}

/// A method beside others.
#[derive(Clone, Debug, Serialize)]
pub struct Agreeing {
    /// Its name.
    pub method: String,
    /// Seeds.
    pub given: usize,
    /// Those that it answered.
    pub answered: usize,
    /// How many it declined with each status.
    pub declined: BTreeMap<String, usize>,
    /// Root mean square distance from the truth that its covariances predict \[px\], of answers that have one.
    pub predicted_px: Option<f64>,
}

/// Two methods on the seeds that both answered.
#[derive(Clone, Debug, Serialize)]
pub struct Pair {
    /// Their names.
    pub methods: [String; 2],
    /// Seeds that both answered.
    pub answered: usize,
    /// Root mean square distance of their answers \[px\].
    pub distance_px: f64,
    /// What both covariances predict of that where errors do not depend on each other \[px\]; of seeds where both have one.
    pub predicted_px: Option<f64>,
}

/// A seed: picture, and the bits of its place.
type Seed<'a> = (&'a str, [u64; 2]);

/// Where a method answered, and the trace of its covariance.
type Answer = ([f64; 2], Option<f64>);

/// A method and its rows.
type Rows<'a> = (&'a str, Vec<&'a Record>);

/// Compares the methods of a run on pictures whose corners nobody knows; nothing where there are no such pictures.
pub fn agreements(records: &[Record], run: &RunDescription) -> Vec<Agreement> {
    let mut rows: HashMap<&str, Vec<&Record>> = HashMap::new();
    for record in records.iter().filter(|record| record.status == status::UNKNOWN) {
        rows.entry(&record.method).or_default().push(record);
    }
    let mut groups: Vec<([&Value; 2], Vec<Rows>)> = Vec::new();
    for pipeline in &run.pipelines {
        let Some(name) = pipeline["name"].as_str() else { continue };
        let Some(rows) = rows.remove(name) else { continue };
        let given_by = [&pipeline["target"], &pipeline["detect"]];
        match groups.iter_mut().find(|(other, _)| *other == given_by) {
            Some((_, methods)) => methods.push((name, rows)),
            None => groups.push((given_by, vec![(name, rows)])),
        }
    }
    groups.iter().map(|(_, methods)| Agreement::of(methods)).collect()
}

impl Agreement {
    fn of(methods: &[Rows]) -> Self {
        let answers: Vec<HashMap<Seed, Answer>> = methods
            .iter()
            .map(|(_, rows)| rows.iter().filter_map(|r| answer(r)).collect())
            .collect();
        let mut pairs = Vec::new();
        for (second, (second_name, _)) in methods.iter().enumerate() {
            for (first, (first_name, _)) in methods[..second].iter().enumerate() {
                let names = [first_name, second_name].map(|name| (*name).to_owned());
                pairs.extend(Pair::of(names, &answers[first], &answers[second]));
            }
        }
        pairs.sort_by(|a, b| a.distance_px.total_cmp(&b.distance_px));
        let first = methods.iter().find_map(|(_, rows)| rows.first());
        let seeds = first.map_or_else(String::new, |record| {
            let stages = [&record.target_extractor, &record.detector];
            stages.into_iter().flatten().cloned().collect::<Vec<_>>().join(", ")
        });
        Self { seeds, methods: methods.iter().map(Agreeing::of).collect(), pairs }
    }
}

impl Agreeing {
    fn of((method, rows): &Rows) -> Self {
        let mut declined = BTreeMap::new();
        for record in rows.iter().filter(|record| !is_answered(record)) {
            *declined.entry(record.refine_status.clone().unwrap_or_default()).or_insert(0) += 1;
        }
        let traces = rows.iter().filter_map(|record| answer(record)?.1.1);
        let deviations: Vec<f64> = traces.map(f64::sqrt).collect();
        Self {
            method: (*method).to_owned(),
            given: rows.len(),
            answered: rows.iter().filter(|record| is_answered(record)).count(),
            declined,
            predicted_px: root_mean_square(&deviations),
        }
    }
}

impl Pair {
    fn of(
        methods: [String; 2],
        first: &HashMap<Seed, Answer>,
        second: &HashMap<Seed, Answer>,
    ) -> Option<Self> {
        let mut both: Vec<(&Seed, &Answer, &Answer)> =
            first.iter().filter_map(|(seed, one)| Some((seed, one, second.get(seed)?))).collect();
        // Sums depend on their order.
        both.sort_by_key(|(seed, ..)| **seed);
        let distances = both.iter().map(|(_, ([x, y], _), ([u, v], _))| (x - u).hypot(y - v));
        let predicted =
            both.iter().filter_map(|(_, (_, one), (_, two))| Some(((*one)? + (*two)?).sqrt()));
        Some(Self {
            methods,
            answered: both.len(),
            distance_px: root_mean_square(&distances.collect::<Vec<_>>())?,
            predicted_px: root_mean_square(&predicted.collect::<Vec<_>>()),
        })
    }
}

/// A row's seed and its answer, where it was not declined.
fn answer(record: &Record) -> Option<(Seed<'_>, Answer)> {
    let seed =
        (record.scene.as_str(), [record.detected_x_px?, record.detected_y_px?].map(f64::to_bits));
    let trace = record.covariance_xx_px2.zip(record.covariance_yy_px2).map(|(xx, yy)| xx + yy);
    let at = [record.refined_x_px?, record.refined_y_px?];
    is_answered(record).then_some((seed, (at, trace.filter(|trace| *trace >= 0.0))))
}

/// What known corners look as if counted from, where that is not what they were read with; nothing of datasets.
pub fn origin_note(records: &[Record], run: &RunDescription) -> Option<String> {
    let pictures = run.pictures.as_ref()?;
    let mut offsets: BTreeMap<&str, Vec<[f64; 2]>> = BTreeMap::new();
    for record in records.iter().filter(|record| is_given(record) && is_answered(record)) {
        let at = [record.refined_x_px, record.refined_y_px];
        // Answers that are their seeds say nothing.
        if at != [record.detected_x_px, record.detected_y_px] {
            let offset = |at: Option<f64>, truth: Option<f64>| Some(at? - truth?);
            let [x, y] = at;
            let offset = offset(x, record.true_x_px).zip(offset(y, record.true_y_px));
            offsets.entry(&record.method).or_default().extend(offset.map(|(x, y)| [x, y]));
        }
    }
    let offsets: Vec<Vec<[f64; 2]>> = offsets.into_values().collect();
    Origin::likely(&offsets, pictures.origin).map(Origin::note)
}

/// That nobody knows the corners, and what follows from it; nothing where somebody does.
pub fn sentence(run: &RunDescription) -> Option<String> {
    let names = &run.pictures.as_ref()?.without_known_corners;
    // Of one split there are fewer.
    let unknown = names.iter().filter(|name| run.scenes.contains(name)).count();
    (unknown > 0).then(|| {
        format!(
            "No corners are known in {unknown} of {} pictures: of these only the methods' agreement is told, and agreement \
             is not accuracy, for methods may err together. --known FILE compares with corners that are known.",
            run.scenes.len()
        )
    })
}

/// What the predictions of pairs mean.
pub const PREDICTED: &str = "predicted: by the refiners' covariances, of a pair as if errors did not depend on each other; \
                             those of one picture do, so a pair may well be nearer than that, and farther means that one \
                             of both is off by more than it says";

/// Methods and pairs as people read them: what they were given, then two tables.
pub fn words(agreement: &Agreement) -> (String, [Words; 2]) {
    let owned = |header: &[&str]| header.iter().map(|&text| text.to_owned()).collect();
    let px = |value: Option<f64>| match value {
        None => "-".to_owned(),
        Some(value) if value != 0.0 && value < 0.001 => format!("{value:.1e}"),
        Some(value) => format!("{value:.3}"),
    };
    let declined = |method: &Agreeing| {
        let of =
            |(status, count): (&String, &usize)| format!("{count} {}", status.replace('_', " "));
        let parts: Vec<String> = method.declined.iter().map(of).collect();
        if parts.is_empty() { "-".to_owned() } else { parts.join(", ") }
    };
    let methods = agreement.methods.iter().map(|method| {
        let answered = format!("{} of {}", method.answered, method.given);
        vec![method.method.clone(), answered, px(method.predicted_px), declined(method)]
    });
    let pairs = agreement.pairs.iter().map(|pair| {
        let [first, second] = pair.methods.clone();
        let count = pair.answered.to_string();
        vec![first, second, count, px(Some(pair.distance_px)), px(pair.predicted_px)]
    });
    let tables = [
        Words {
            header: owned(&["method", "answered", "predicted rms px", "declined"]),
            rows: methods.collect(),
        },
        Words {
            header: owned(&["method", "and", "both answered", "rms apart px", "predicted px"]),
            rows: pairs.collect(),
        },
    ];
    (format!("Corners that {} found:", agreement.seeds), tables)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::kind;

    fn row(method: &str, seed_px: f64, refined_px: f64, refine_status: &str) -> Record {
        Record {
            scene: "a.png".into(),
            method: method.into(),
            kind: kind::CORNER.into(),
            status: status::UNKNOWN.into(),
            detected_x_px: Some(seed_px),
            detected_y_px: Some(0.0),
            refined_x_px: Some(refined_px),
            refined_y_px: Some(0.0),
            refine_status: Some(refine_status.into()),
            covariance_xx_px2: Some(0.03),
            covariance_xy_px2: Some(0.0),
            covariance_yy_px2: Some(0.01),
            ..Record::default()
        }
    }

    #[test]
    fn pairs_are_of_seeds_that_both_answered() {
        let first = [row("a", 1.0, 1.1, "ok"), row("a", 5.0, 5.0, "ok"), row("a", 9.0, 9.0, "ok")];
        let second = [row("b", 1.0, 1.4, "ok"), row("b", 5.0, 5.4, "max_iterations")];
        let second = [&second[..], &[row("b", 9.0, 9.0, "singular")]].concat();
        let found = Agreement::of(&[("a", first.iter().collect()), ("b", second.iter().collect())]);
        assert_eq!(found.methods[1].declined["singular"], 1);
        assert_eq!((found.methods[1].answered, found.methods[1].given), (2, 3));
        assert!((found.methods[0].predicted_px.expect("covariances") - 0.2).abs() < 1e-12);
        let [pair] = &found.pairs[..] else { panic!("one pair: {:?}", found.pairs) };
        assert_eq!(pair.answered, 2);
        assert!((pair.distance_px - 0.125_f64.sqrt()).abs() < 1e-12, "{pair:?}");
        assert!((pair.predicted_px.expect("covariances") - 0.08_f64.sqrt()).abs() < 1e-12);
    }
}
