//! Placeholder.

use crate::detect::Detector;
use crate::registry::Entry;

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "harris",
    summary: "",
    reference: "",
    version: 1,
    build: |_, _| Err(crate::error::Error::Other(String::new())),
};
