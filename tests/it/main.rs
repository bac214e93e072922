//! Every integration test, one module per kind.

mod contract;
mod drawn;
mod grasp;
mod oracle;
