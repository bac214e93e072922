//! The chessboard corners of the crate `chess-corners`, and how a program in Rust takes part: `scripts/PROTOCOL.md`.
//!
//! Its detector ChESS (Bennett & Lasenby 2014) on one scale, each corner at the centre of mass of the responses about it,
//! by the crate's defaults but for the orientation of corners, which nobody asks for. Parameter `strategy`: "chess" or
//! "radon". It has no region: answers beside the one that is asked for are dropped by who asks.

use std::io::{BufRead, Write};
use std::time::Instant;

use chess_corners::{Detector, DetectorConfig};
use serde::Deserialize;
use serde_json::{Value, json};

#[derive(Deserialize)]
struct Greeting {
    parameters: Parameters,
}

#[derive(Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Parameters {
    strategy: String,
}

impl Default for Parameters {
    fn default() -> Self {
        Self { strategy: "chess".to_owned() }
    }
}

/// What is needed of a question.
#[derive(Deserialize)]
struct Question {
    id: u64,
    image: Image,
}

#[derive(Deserialize)]
struct Image {
    file: std::path::PathBuf,
    width: u32,
    height: u32,
}

/// A corner's ring is so wide \[px\].
const RING_PX: u32 = 11;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut lines = std::io::stdin().lock().lines();
    let Some(greeting) = lines.next() else { return Ok(()) };
    let greeting: Greeting = serde_json::from_str(&greeting?)?;
    let config = match greeting.parameters.strategy.as_str() {
        "chess" => DetectorConfig::chess(),
        "radon" => DetectorConfig::radon(),
        other => {
            return Err(format!("strategy is {other:?}, must be \"chess\" or \"radon\"").into());
        }
    };
    let mut detector = Detector::new(config.without_orientation())?;
    say(&json!({
        "protocol": 1,
        "version": "1",
        "libraries": { "chess-corners": version() },
        "does": ["detect"],
    }))?;
    for line in lines {
        let question: Question = serde_json::from_str(&line?)?;
        say(&match answer(&mut detector, &question) {
            Ok(answer) => answer,
            Err(error) => json!({ "id": question.id, "error": error.to_string() }),
        })?;
    }
    Ok(())
}

fn answer(
    detector: &mut Detector,
    question: &Question,
) -> Result<Value, Box<dyn std::error::Error>> {
    let Image { file, width, height } = &question.image;
    // In a picture smaller than a ring the crate has nothing to look at, and of one pixel it panics.
    if *width.min(height) < RING_PX {
        return Ok(json!({ "id": question.id, "points": [] }));
    }
    let mut samples = std::fs::read(file)?;
    // The file may be longer: it never shrinks.
    samples.truncate(*width as usize * *height as usize);
    let begun = Instant::now();
    let corners = detector.detect_u8(&samples, *width, *height)?;
    let took_us = 1e6 * begun.elapsed().as_secs_f64();
    Ok(json!({
        "id": question.id,
        "took_us": took_us,
        "points": corners.iter().map(|corner| [corner.x, corner.y]).collect::<Vec<_>>(),
        "responses": corners.iter().map(|corner| corner.response).collect::<Vec<_>>(),
    }))
}

/// The crate's version, as it is locked.
fn version() -> &'static str {
    let lock = include_str!("../Cargo.lock");
    let behind = lock.split("name = \"chess-corners\"\nversion = \"").nth(1);
    behind.and_then(|rest| rest.split('"').next()).unwrap_or("")
}

fn say(answer: &Value) -> std::io::Result<()> {
    let mut output = std::io::stdout().lock();
    writeln!(output, "{answer}")?;
    output.flush()
}
