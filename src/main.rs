//! The `cornerbench` command.

fn main() {}
