//! Every integration test, one module per kind.

mod grasp;
