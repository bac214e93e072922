//! Algorithms that are other programs: started once, asked line by line, ended at their deadline.
//!
//! What is said is described in `scripts/PROTOCOL.md`. A program sees what an own algorithm sees: an exposure, and what
//! a user would know. Whatever it does wrong is a [`Failure`], a counted row with its reason, and never an answer.

mod answer_file;
mod block;
mod log;
mod needs;
mod process;
mod program;
mod protocol;

pub use answer_file::{AnswerFile, is_answer_file};
pub use block::{Block, Surroundings, blocks, schema};
pub use needs::{Channels, Meaning, Needs, Sample};
pub use program::{Asked, Failure, FailureKind, Program, Reply};
pub use protocol::{PROTOCOL, Task};
