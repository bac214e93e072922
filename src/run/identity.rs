//! What a run is: its description, and the hash by which its parts are told from another's.

use serde_json::json;

use super::{DRAWN, Images, Run, Source, Unit};
use crate::files::sha256_hex;
use crate::plan::{Cell, Pipeline};
use crate::record::{FailureCount, RunDescription};
use crate::sensor::Photographer;

impl Run<'_> {
    pub(super) fn description(
        &self,
        identity: &str,
        command: &str,
        unreadable: Vec<String>,
        failures: Vec<FailureCount>,
    ) -> RunDescription {
        let (shots, corner_rule) = (self.shots(), self.plan.corner_rule);
        RunDescription {
            cornerbench_version: env!("CARGO_PKG_VERSION").to_owned(),
            plan: self.plan.name.clone(),
            pipelines: self.plan.pipelines.iter().map(Pipeline::description).collect(),
            cameras: self
                .cameras()
                .into_iter()
                .map(|camera| (camera.name().to_owned(), camera.model().clone()))
                .collect(),
            phases: shots.phases,
            repeats: shots.repeats,
            cells: self.plan.cells.iter().map(Cell::description).collect(),
            suite: self.suite().to_owned(),
            scenes: self.units.iter().map(|unit| unit.name.clone()).collect(),
            shard: self.shard.map(|shard| shard.to_string()),
            unreadable,
            identity_sha256: identity.to_owned(),
            range_sensor_model: self.plan.range_sensor_model.clone(),
            range_sensor: self.plan.range_sensor.clone(),
            gate_px: corner_rule.gate_px,
            least_edge_px: corner_rule.least_edge_px,
            most_bound_px: corner_rule.most_bound_px,
            command: command.to_owned(),
            machine: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            renderers: self.renderers(),
            programs: self.plan.programs().iter().map(|program| program.description()).collect(),
            failures,
            pictures: match self.source {
                Source::Album(album) => Some(album.description()),
                _ => None,
            },
        }
    }

    pub(super) fn suite(&self) -> &str {
        match self.source {
            Source::Dataset(dataset) => dataset.suite(),
            Source::Album(album) => album.suite(),
            Source::Drawn => DRAWN,
        }
    }

    /// What rendered the scenes, each once.
    fn renderers(&self) -> Vec<String> {
        let Source::Dataset(dataset) = self.source else { return Vec::new() };
        let mut renderers: Vec<String> = self
            .units
            .iter()
            .filter_map(|unit| dataset.renderer(&unit.name))
            .map(|renderer| format!("{} {} {}", renderer.name, renderer.version, renderer.variant))
            .collect();
        renderers.sort();
        renderers.dedup();
        renderers
    }

    /// A hash of all that decides the records: program, plan, cameras, scenes; not which of them.
    pub(super) fn identity(&self) -> String {
        let plan = self.plan;
        let cameras: Vec<_> = self.cameras().into_iter().map(Photographer::identity).collect();
        let rule = plan.corner_rule;
        let fingerprint = |unit: &Unit| match unit.images {
            Images::Scene(dataset) => Some(dataset.fingerprint(&unit.name)),
            _ => None,
        };
        let scenes: Vec<_> =
            self.units.iter().map(|unit| (&unit.name, fingerprint(unit))).collect();
        let cells: Vec<_> = plan.cells.iter().map(Cell::description).collect();
        let pipelines: Vec<_> = plan.pipelines.iter().map(Pipeline::description).collect();
        let programs = plan.programs();
        let programs: Vec<_> = programs.iter().map(|program| program.sha256()).collect();
        let mut all = json!({
            "cornerbench": env!("CARGO_PKG_VERSION"),
            "cameras": cameras,
            "shots": self.shots(),
            "range_sensor": [json!(plan.range_sensor), json!(plan.range_sensor_model)],
            "rule": [rule.gate_px, rule.least_edge_px, rule.most_bound_px],
            "pipelines": pipelines,
            "programs": programs,
            "cells": cells,
            "suite": self.suite(),
            "scenes": scenes,
        });
        if let Source::Album(album) = self.source {
            all["pictures"] = album.identity();
        }
        sha256_hex(all.to_string().as_bytes())
    }
}
