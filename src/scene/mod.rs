//! A rendered scene on disk: manifest, truth, film, geometry buffers, integrity.
//!
//! The files are described in `scenes/FORMAT.md`.

mod dataset;
mod description;
mod film;
mod geometry;
mod layers;
mod truth;

pub use dataset::{Dataset, FORMAT, Renderer, Scene};
pub use description::{Description, FilmDescription, Lens, Split, TargetDescription, TargetKind};
pub use film::{Coverage, Film};
pub use geometry::{Geometry, NO_FACE, RangeRays, Surface};
pub use truth::{
    Cause, EdgeAtCorner, EdgeEnd, FaceAtCorner, FalseJunction, IntervalEnd, SeenInterval,
    TrueCorner, TrueEdge, TrueFace, Truth, Visibility,
};
