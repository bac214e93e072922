//! One Criterion binary, one module per stage: `cargo bench`, or `cargo bench -- --test` to run each
//! once. `cargo bench --bench stages -- detect` also times OpenCV, scikit-image and kornia.

mod stages {
    pub mod detect;
    pub mod expose;
    pub mod peers;
    pub mod photograph;
    pub mod refine;
    pub mod target;
    pub mod turns;
}

fn main() {
    let mut criterion = criterion::Criterion::default().configure_from_args();
    stages::expose::define(&mut criterion);
    stages::target::define(&mut criterion);
    stages::detect::define(&mut criterion);
    stages::refine::define(&mut criterion);
    criterion.final_summary();
}

/// Whether a comparison that Criterion does not time is to be made: as a benchmark of this name would
/// be, but not where each only runs once or is listed.
fn asked(name: &str) -> bool {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let has = |option: &str| arguments.iter().any(|argument| argument == option);
    let mut filters = arguments.iter().filter(|argument| !argument.starts_with('-')).peekable();
    let passes = filters.peek().is_none() || filters.any(|filter| name.contains(filter.as_str()));
    has("--bench") && !has("--test") && !has("--list") && passes
}
