//! Times of one thing and of another, in turns, and how their ratios spread.

use std::fmt;
use std::time::Instant;

/// Of several rounds the one in the middle, the least and the most.
#[derive(Clone, Copy, Debug)]
pub struct Spread {
    pub middle: f64,
    pub least: f64,
    pub most: f64,
}

impl Spread {
    /// # Panics
    /// Of no round.
    pub fn of(mut rounds: Vec<f64>) -> Self {
        rounds.sort_by(f64::total_cmp);
        let most = rounds[rounds.len() - 1];
        Self { middle: rounds[rounds.len() / 2], least: rounds[0], most }
    }
}

/// "2.07 (1.89 to 2.20)", of so many digits as are asked for.
impl fmt::Display for Spread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { middle, least, most } = self;
        let digits = f.precision().unwrap_or(2);
        write!(f, "{middle:.digits$} ({least:.digits$} to {most:.digits$})")
    }
}

/// How long something takes that is done several times \[s\].
#[derive(Clone, Copy, Debug)]
pub struct Times {
    pub least_s: f64,
    pub median_s: f64,
}

impl Times {
    /// Does it so often.
    pub fn of(repeats: usize, mut once: impl FnMut()) -> Self {
        let took_s = (0..repeats).map(|_| {
            let begun = Instant::now();
            once();
            begun.elapsed().as_secs_f64()
        });
        let Spread { middle, least, .. } = Spread::of(took_s.collect());
        Self { least_s: least, median_s: middle }
    }
}

/// A pool of so many threads.
pub fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

/// How many times as long something takes on one thread as on `threads`; it says how long it took.
pub fn speed_up(threads: usize, mut took_s: impl FnMut() -> f64 + Send) -> Spread {
    const ROUNDS: usize = 7;
    let (one, all) = (pool(1), pool(threads));
    Spread::of((0..ROUNDS).map(|_| one.install(&mut took_s) / all.install(&mut took_s)).collect())
}
