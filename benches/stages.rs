//! One Criterion binary, one module per stage.

fn main() {}
