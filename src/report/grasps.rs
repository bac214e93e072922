//! What became of the grasps of one method: how many, how far off, how turned, and how often good enough.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::record::{Record, kind, status};
use crate::report::refinement::{Estimate, estimate, quantile};
use crate::stats;

/// A grasp is as good as that: no farther from the face's centre \[mm\], its approach and jaws turned by no more \[deg\].
pub const GOOD: [[f64; 2]; 4] = [[1.0, 1.0], [2.0, 2.0], [5.0, 5.0], [10.0, 10.0]];

/// What became of the grasps.
#[derive(Clone, Debug, Default, Serialize)]
pub struct GraspSummary {
    /// Photographs: grasps asked for.
    pub asked: usize,
    /// Grasp points computed.
    pub answered: usize,
    /// Photographs in which the least occluded face was chosen.
    pub face_right: usize,
    /// Grasp points on a quadrilateral that covers no face.
    pub no_face_covered: usize,
    /// Why there was none, and how often.
    pub reasons: BTreeMap<String, usize>,
    /// Median distance from the true face's centre \[mm\].
    pub median_error_mm: Option<f64>,
    /// Median of its part along the optical axis, without sign \[mm\].
    pub median_axial_error_mm: Option<f64>,
    /// Median of its part across the optical axis \[mm\].
    pub median_lateral_error_mm: Option<f64>,
    /// Median distance, with its interval over scenes \[mm\].
    pub error_mm: Option<Estimate>,
    /// Median of its part in the face \[mm\].
    pub median_in_face_error_mm: Option<f64>,
    /// Median of its part along the face's normal, without sign \[mm\].
    pub median_normal_error_mm: Option<f64>,
    /// Median angle between the approach and the face's normal, with its interval over scenes \[deg\].
    pub approach_error_deg: Option<Estimate>,
    /// Median angle between the jaws and the shorter side \[deg\].
    pub median_jaw_error_deg: Option<f64>,
    /// Share of all asked for whose grasp is as good as each of [`GOOD`], with its interval over scenes; none of a method
    /// that tells no approach.
    pub good: [Option<Estimate>; GOOD.len()],
    /// Median squared error over the covariance that the method says: 2.37 where that is right.
    pub median_nees: Option<f64>,
    /// Median of the largest distance of a vertex of the cuboid \[mm\].
    pub median_mssd_mm: Option<f64>,
    /// Median of the same in the image \[px\].
    pub median_mspd_px: Option<f64>,
}

/// Summarises the records of one method; None where it has no grasps.
pub fn summarise(records: &[&Record]) -> Option<GraspSummary> {
    let asked: Vec<&Record> = records.iter().copied().filter(|r| r.kind == kind::GRASP).collect();
    let answered: Vec<&Record> = asked.iter().copied().filter(|r| r.status == status::OK).collect();
    if asked.is_empty() {
        return None;
    }
    let median = |value: &dyn Fn(&Record) -> Option<f64>| {
        stats::median(&answered.iter().filter_map(|record| value(record)).collect::<Vec<_>>())
    };
    let with_interval = |value: &dyn Fn(&Record) -> Option<f64>| {
        let mut scenes: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for record in &answered {
            scenes.entry(&record.scene).or_default().extend(value(record));
        }
        quantile(&scenes.into_values().collect::<Vec<_>>(), 0.5)
    };
    let mut reasons = BTreeMap::new();
    for record in asked.iter().filter(|record| record.status != status::OK) {
        let reason = record.reason.as_ref().filter(|_| record.status != status::FAILED);
        *reasons.entry(reason.unwrap_or(&record.status).clone()).or_insert(0) += 1;
    }
    let tells_approach = answered.iter().any(|record| record.approach_error_deg.is_some());
    Some(GraspSummary {
        asked: asked.len(),
        answered: answered.len(),
        face_right: asked.iter().filter(|r| r.face_is_right == Some(true)).count(),
        no_face_covered: answered.iter().filter(|r| r.chosen_face.is_none()).count(),
        reasons,
        median_error_mm: median(&|r| r.grasp_error_mm),
        median_axial_error_mm: median(&|r| r.grasp_axial_error_mm.map(f64::abs)),
        median_lateral_error_mm: median(&|r| r.grasp_lateral_error_mm),
        error_mm: with_interval(&|r| r.grasp_error_mm),
        median_in_face_error_mm: median(&|r| r.grasp_in_face_error_mm),
        median_normal_error_mm: median(&|r| r.grasp_normal_error_mm.map(f64::abs)),
        approach_error_deg: with_interval(&|r| r.approach_error_deg),
        median_jaw_error_deg: median(&|r| r.jaw_error_deg),
        good: GOOD.map(|limits| tells_approach.then(|| share_of_good(&asked, limits)).flatten()),
        median_nees: median(&|r| r.grasp_nees),
        median_mssd_mm: median(&|r| r.pose_mssd_mm),
        median_mspd_px: median(&|r| r.pose_mspd_px),
    })
}

/// Of all asked for: what is declined is not good. A grasp of no true face is none.
fn share_of_good(asked: &[&Record], [most_mm, most_deg]: [f64; 2]) -> Option<Estimate> {
    let is_good = |record: &Record| {
        record.chosen_face.is_some()
            && record.grasp_error_mm.is_some_and(|error_mm| error_mm <= most_mm)
            && [record.approach_error_deg, record.jaw_error_deg]
                .iter()
                .all(|error_deg| error_deg.is_some_and(|error_deg| error_deg <= most_deg))
    };
    let mut scenes: BTreeMap<&str, [f64; 2]> = BTreeMap::new();
    for record in asked {
        let [good, all] = scenes.entry(&record.scene).or_default();
        *good += f64::from(is_good(record));
        *all += 1.0;
    }
    let scenes: Vec<[f64; 2]> = scenes.into_values().collect();
    estimate(&scenes, &|[good, all]| (*all > 0.0).then(|| good / all))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grasp(scene: &str, error_mm: f64, error_deg: Option<f64>) -> Record {
        Record {
            scene: scene.into(),
            kind: kind::GRASP.into(),
            status: status::OK.into(),
            chosen_face: Some(5),
            grasp_error_mm: Some(error_mm),
            approach_error_deg: error_deg,
            jaw_error_deg: error_deg,
            ..Record::default()
        }
    }

    #[test]
    fn good_is_near_and_turned_little_and_of_a_face() {
        let declined = Record {
            status: status::NO_GRASP.into(),
            reason: Some("ambiguous".into()),
            ..grasp("d", 0.0, None)
        };
        let rows = [
            grasp("a", 0.5, Some(0.5)),
            grasp("b", 1.5, Some(0.5)),
            grasp("c", 0.5, Some(4.0)),
            Record { chosen_face: None, ..grasp("c", 0.5, Some(0.5)) },
            declined,
        ];
        let summary = summarise(&rows.iter().collect::<Vec<_>>()).expect("grasps");
        for (share, wanted) in summary.good.into_iter().zip([0.2, 0.4, 0.6, 0.6]) {
            assert!((share.expect("a share").value - wanted).abs() < 1e-12, "{share:?}");
        }
        assert_eq!((summary.asked, summary.answered), (5, 4));
        assert_eq!(summary.reasons["ambiguous"], 1);
    }

    #[test]
    fn a_point_alone_is_neither_good_nor_bad() {
        let rows = [grasp("a", 0.5, None)];
        let summary = summarise(&rows.iter().collect::<Vec<_>>()).expect("grasps");
        assert!(summary.good.iter().all(Option::is_none));
        assert!(summarise(&[]).is_none());
    }

    #[test]
    fn each_median_is_of_its_own_part_without_sign() {
        let row = Record {
            grasp_axial_error_mm: Some(-1.0),
            grasp_lateral_error_mm: Some(2.0),
            grasp_in_face_error_mm: Some(3.0),
            grasp_normal_error_mm: Some(-4.0),
            ..grasp("a", 5.0, None)
        };
        let found = summarise(&[&row]).expect("a grasp");
        assert_eq!(found.median_error_mm, Some(5.0));
        assert_eq!(found.median_axial_error_mm, Some(1.0));
        assert_eq!(found.median_lateral_error_mm, Some(2.0));
        assert_eq!(found.median_in_face_error_mm, Some(3.0));
        assert_eq!(found.median_normal_error_mm, Some(4.0));
    }
}
