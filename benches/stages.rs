//! One Criterion binary, one module per stage: `cargo bench`, or `cargo bench -- --test` to run each
//! once.

mod stages {
    pub mod detect;
    pub mod expose;
    pub mod photograph;
    pub mod refine;
    pub mod target;
}

fn main() {
    let mut criterion = criterion::Criterion::default().configure_from_args();
    stages::expose::define(&mut criterion);
    stages::target::define(&mut criterion);
    stages::detect::define(&mut criterion);
    stages::refine::define(&mut criterion);
    criterion.final_summary();
}
