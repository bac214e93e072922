//! A rendered scene on disk: manifest, truth, film, geometry buffers, integrity.

mod film;

pub use film::Film;
