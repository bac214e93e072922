//! Placeholder.

use crate::grasp::FaceSelector;
use crate::registry::Entry;

/// The registry's line.
pub const ENTRY: Entry<dyn FaceSelector> = Entry {
    name: "least_occluded",
    summary: "",
    reference: "",
    version: 1,
    build: |_, _| Err(crate::error::Error::Other(String::new())),
};
