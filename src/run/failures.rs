//! What went wrong with other programs: counted from rows, so that a run that goes on knows of the first part's.

use std::sync::Arc;

use super::score::{failure_record, of_pipeline};
use crate::plan::{Pipeline, Plan};
use crate::record::{FailureCount, Record, kind};

/// Counts the failures among rows.
pub(super) fn count(records: &[Record]) -> Vec<FailureCount> {
    let failures = records.iter().filter(|record| record.kind == kind::FAILURE);
    let one = |record: &Record| FailureCount {
        method: record.method.clone(),
        status: record.status.clone(),
        count: 1,
        scenes: Some(record.scene.clone()).filter(|scene| !scene.is_empty()).into_iter().collect(),
        reason: record.reason.clone().unwrap_or_default(),
    };
    sum(failures.map(one))
}

/// Each method and status once, photographs and ends apart, with the first one's reason.
pub(super) fn sum(all: impl Iterator<Item = FailureCount>) -> Vec<FailureCount> {
    let mut sum: Vec<FailureCount> = Vec::new();
    for more in all {
        let is_its = |one: &&mut FailureCount| {
            (&one.method, &one.status) == (&more.method, &more.status)
                && one.is_of_the_end() == more.is_of_the_end()
        };
        match sum.iter_mut().find(is_its) {
            Some(one) => {
                one.count += more.count;
                let new = more.scenes.into_iter().filter(|scene| !one.scenes.contains(scene));
                let new: Vec<String> = new.collect();
                one.scenes.extend(new);
            }
            None => sum.push(more),
        }
    }
    sum
}

/// How many there are.
pub(super) fn total(failures: &[FailureCount]) -> usize {
    failures.iter().map(|failure| failure.count).sum()
}

/// Ends the plan's programs, and gives a row of each pipeline for one that did not end well.
pub(super) fn end_programs(plan: &Plan, suite: &str) -> Vec<Record> {
    let mut records = Vec::new();
    for program in plan.programs() {
        let Err(failure) = program.end() else { continue };
        let is_its =
            |pipeline: &&Pipeline| pipeline.programs().any(|one| Arc::ptr_eq(one, program));
        records.extend(plan.pipelines.iter().filter(is_its).map(|pipeline| {
            let template = Record { suite: suite.to_owned(), ..of_pipeline(pipeline) };
            failure_record(&template, &failure)
        }));
    }
    records
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photographs_and_ends_are_counted_apart() {
        let failure = |scenes: &[&str]| FailureCount {
            method: "mine".into(),
            status: "crashed".into(),
            count: 1,
            scenes: scenes.iter().map(|&scene| scene.to_owned()).collect(),
            reason: "gone".into(),
        };
        let all = [failure(&["a"]), failure(&[]), failure(&["b"]), failure(&["a"]), failure(&[])];
        let photographs = FailureCount { count: 3, ..failure(&["a", "b"]) };
        assert_eq!(sum(all.into_iter()), [photographs, FailureCount { count: 2, ..failure(&[]) }]);
    }
}
