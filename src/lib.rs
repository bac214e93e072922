//! cornerbench: how good is a sub-pixel corner, really, and what does it buy a robot that has to
//! grasp?
//!
//! Mitsuba renders occluded red-cuboid scenes with exact truth; this library photographs them, runs
//! corner algorithms over the photographs and reports how far each corner and each grasp point is
//! from the truth. Data flows one way: [`scene`] -> [`sensor`] -> [`target`] -> [`detect`] ->
//! [`refine`] -> [`grasp`].

pub mod bound;
pub mod cli;
pub mod contract;
pub mod convention;
pub mod cuboid;
pub mod detect;
pub mod error;
pub mod export;
pub mod external;
pub mod files;
pub mod filter;
pub mod geometry;
pub mod grasp;
pub mod image;
pub mod junction;
pub mod matching;
pub mod metrics;
pub mod picture;
pub mod plan;
pub mod random;
pub mod record;
pub mod refine;
pub mod registry;
pub mod report;
pub mod run;
pub mod scene;
pub mod sensor;
pub mod stats;
pub mod target;
pub mod vector;
