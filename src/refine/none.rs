//! Placeholder.

use crate::refine::Refiner;
use crate::registry::Entry;

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "none",
    summary: "",
    reference: "",
    version: 1,
    build: |_, _| Err(crate::error::Error::Other(String::new())),
};
