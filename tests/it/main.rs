//! Every integration test, one module per kind.

mod camera;
mod cli;
mod contract;
mod cuboids;
mod dataset;
mod detectors;
mod docs;
mod drawn;
mod edges;
mod export;
mod grasp;
mod junctions;
mod layers;
mod limits;
mod lines;
mod opencv;
mod oracle;
mod peaks;
mod python;
mod range_sensors;
mod refiners;
mod rendering;
mod responses;
mod scoring;
mod setup;
mod support;
