//! Rendering that loses nothing: interrupts, killed workers, choices of scenes, several processes.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support::{copy_folder, cornerbench, kept, recipes, run, stderr, succeed};

const SCENES: [&str; 4] = ["one", "two", "two-again", "four"];

/// Rendering of suite `tiny` into a folder.
fn tiny(folder: &Path, options: &[&str]) -> Command {
    let mut command = cornerbench();
    command.args(["render", "tiny", "--output"]).arg(folder);
    command.arg("--recipes").arg(recipes()).args(options);
    command
}

/// Suite `tiny`, rendered on first use by two workers.
fn tiny_dataset() -> &'static Path {
    static DATASET: OnceLock<PathBuf> = OnceLock::new();
    DATASET.get_or_init(|| {
        let folder = kept("tiny");
        succeed(&mut tiny(&folder, &["--jobs", "2"]));
        folder
    })
}

/// Every file of a dataset, hidden ones included.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        if path.is_dir() {
            let inner = contents(&path);
            found.extend(
                inner.into_iter().map(|(file, bytes)| (Path::new(&name).join(file), bytes)),
            );
        } else {
            found.insert(name.into(), fs::read(path).expect("a file"));
        }
    }
    found
}

#[track_caller]
fn assert_is_tiny_dataset(folder: &Path) {
    let (found, expected) = (contents(folder), contents(tiny_dataset()));
    assert!(found.keys().eq(expected.keys()), "{:?}", found.keys());
    for (file, bytes) in expected {
        assert!(found[&file] == bytes, "{} differs", file.display());
    }
}

/// The scenes that a dataset's index names, by alphabet.
fn indexed(folder: &Path) -> Vec<String> {
    let bytes = fs::read(folder.join("dataset.json")).expect("an index");
    let index: Value = serde_json::from_slice(&bytes).expect("JSON");
    index["scenes"].as_object().expect("scenes").keys().cloned().collect()
}

/// The scenes whose folders are whole, by alphabet.
fn whole(folder: &Path) -> Vec<&'static str> {
    let mut scenes = SCENES;
    scenes.sort_unstable();
    scenes.into_iter().filter(|scene| folder.join(scene).join("files.json").is_file()).collect()
}

fn is_unfinished(entry: &fs::DirEntry) -> bool {
    entry.file_name().to_string_lossy().starts_with(".rendering")
}

fn unfinished(folder: &Path) -> usize {
    fs::read_dir(folder).expect("a folder").flatten().filter(is_unfinished).count()
}

#[test]
fn one_worker_gives_the_same_bytes_as_two() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    succeed(&mut tiny(folder.path(), &["--jobs", "1", "--threads", "2"]));
    assert_is_tiny_dataset(folder.path());
}

#[test]
fn shards_that_render_at_the_same_time_into_one_folder_give_the_whole_dataset() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shards = ["0/2", "1/2"].map(|shard| {
        let mut command = tiny(folder.path(), &["--shard", shard, "--jobs", "1", "--threads", "1"]);
        command.stderr(Stdio::null()).spawn().expect("the program starts")
    });
    for mut shard in shards {
        assert!(shard.wait().expect("it ends").success());
    }
    assert_is_tiny_dataset(folder.path());
}

/// A rendering whose words are read as they come.
struct Rendering {
    child: Child,
    words: BufReader<std::process::ChildStderr>,
}

impl Rendering {
    fn start(mut command: Command) -> Self {
        let mut child = command.stderr(Stdio::piped()).spawn().expect("the program starts");
        let words = BufReader::new(child.stderr.take().expect("standard error"));
        Self { child, words }
    }

    /// Waits for a line that begins with a word.
    fn wait_for(&mut self, word: &str) {
        let found = self.words.by_ref().lines().map_while(Result::ok).any(|l| l.starts_with(word));
        assert!(found, "it never said {word:?}");
    }

    fn send(&self, signal: &str) {
        send(signal, self.child.id());
    }

    /// Waits for the end; returns exit code and the last words.
    fn end(mut self) -> (Option<i32>, String) {
        let mut words = String::new();
        self.words.read_to_string(&mut words).expect("text");
        (self.child.wait().expect("it ends").code(), words)
    }
}

fn send(signal: &str, process: u32) {
    succeed(Command::new("kill").args([signal, &process.to_string()]));
}

#[test]
fn an_interrupt_and_a_termination_keep_what_is_finished_and_say_how_to_go_on() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for signal in ["-INT", "-TERM"] {
        let mut rendering = Rendering::start(tiny(folder.path(), &["--jobs", "1"]));
        rendering.wait_for("rendered ");
        rendering.send(signal);
        let (code, words) = rendering.end();
        assert_eq!(code, Some(130), "{signal}: {words}");
        let scenes = indexed(folder.path());
        assert!((1..4).contains(&scenes.len()), "{signal}: {scenes:?}");
        assert_eq!(scenes, whole(folder.path()), "{signal}");
        assert_eq!(unfinished(folder.path()), 0, "{signal}");
        let kept = format!("interrupted: {} of 4 scenes are rendered and kept", scenes.len());
        assert!(words.contains(&kept), "{signal}: {words}");
        let again = format!("cornerbench render tiny -o {}", folder.path().display());
        assert!(words.contains(&again), "{signal}: {words}");
    }
    succeed(&mut tiny(folder.path(), &[]));
    assert_is_tiny_dataset(folder.path());
}

/// The processes below a process that render.
fn workers_below(process: u32) -> Vec<u32> {
    let children = fs::read_to_string(format!("/proc/{process}/task/{process}/children"));
    let children = children.expect("a list of processes");
    let mut found = Vec::new();
    for child in children.split_whitespace().map(|child| child.parse().expect("a number")) {
        let line = fs::read_to_string(format!("/proc/{child}/cmdline")).unwrap_or_default();
        if line.contains("spawn_main") {
            found.push(child);
        }
        found.extend(workers_below(child));
    }
    found
}

#[cfg(target_os = "linux")]
#[test]
fn a_killed_worker_costs_one_scene_which_can_be_rendered_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let rendering = Rendering::start(tiny(folder.path(), &["--jobs", "1"]));
    let deadline = Instant::now() + Duration::from_secs(120);
    while !folder.path().is_dir() || unfinished(folder.path()) == 0 {
        assert!(Instant::now() < deadline, "no scene is begun with");
        std::thread::sleep(Duration::from_millis(5));
    }
    let workers = workers_below(rendering.child.id());
    assert_eq!(workers.len(), 1, "{workers:?}");
    send("-KILL", workers[0]);
    let (code, words) = rendering.end();
    assert_eq!(code, Some(1), "{words}");
    assert!(words.contains("one failed: its worker process was ended by SIGKILL"), "{words}");
    assert!(words.contains("its seeds are those of \"tiny/one\""), "{words}");
    assert!(words.contains("--scenes one"), "{words}");
    assert_eq!(indexed(folder.path()), ["four", "two", "two-again"]);
    assert_eq!(unfinished(folder.path()), 0);

    let other = folder.path().join("two/film.exr");
    let modified = || fs::metadata(&other).expect("a film").modified().expect("a time");
    let before = modified();
    let text = stderr(&run(&mut tiny(folder.path(), &["--scenes", "one"])));
    assert!(text.contains("0 of 1 scenes are rendered"), "{text}");
    assert_eq!(modified(), before);
    assert_is_tiny_dataset(folder.path());
}

#[test]
fn a_choice_of_scenes_leaves_all_others_even_those_of_another_recipe() {
    let copy = tempfile::tempdir().expect("a temporary folder");
    let (changed, dataset) = (copy.path().join("recipes"), copy.path().join("dataset"));
    copy_folder(&recipes(), &changed);
    copy_folder(tiny_dataset(), &dataset);
    let family = changed.join("families/tiny.toml");
    let text = fs::read_to_string(&family).expect("a family");
    let other = text.replace("yaw_deg = [10.0, 20.0]", "yaw_deg = [10.0, 21.0]");
    assert_ne!(text, other);
    fs::write(&family, other).expect("written");

    let mut command = cornerbench();
    command.args(["render", "tiny", "--scenes", "0..1", "--output"]).arg(&dataset);
    succeed(command.arg("--recipes").arg(&changed));
    assert_eq!(indexed(&dataset), ["one"], "what is outdated does not count");
    assert_eq!(whole(&dataset).len(), 4, "but is there");

    let text = stderr(&run(&mut tiny(&dataset, &[])));
    assert!(text.contains("3 of 4 scenes are rendered"), "{text}");
    assert_is_tiny_dataset(&dataset);
}

#[test]
fn an_estimate_says_what_the_missing_scenes_take_and_renders_none() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = folder.path().join("dataset");
    let output = run(&mut tiny(&dataset, &["--estimate", "--json", "--scenes", "1.."]));
    let found: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!((&found["missing"], &found["families"][0]["scenes"]), (&3.into(), &3.into()));
    for sum in ["seconds", "bytes"] {
        let [low, expected, high] = ["low", "expected", "high"].map(|key| found[sum][key].as_f64());
        assert!(Some(0.0) < low && low < expected && expected < high, "{sum}: {found}");
    }
    assert!(!dataset.exists());
    let none = run(&mut tiny(tiny_dataset(), &["--estimate"]));
    assert_eq!(String::from_utf8_lossy(&none.stdout), "nothing is missing\n");
}

#[test]
fn a_cluster_without_ray_is_refused_with_the_next_step() {
    let project = tempfile::tempdir().expect("a temporary folder");
    for folder in ["scenes/suites", "scripts/cornerscenes"] {
        fs::create_dir_all(project.path().join(folder)).expect("a folder");
    }
    fs::write(project.path().join("scripts/requirements-ray.txt"), "").expect("a lock");
    let output = run(tiny(Path::new("dataset"), &["--ray"]).current_dir(project.path()));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("run cornerbench setup --ray"), "{}", stderr(&output));
}

#[test]
fn scenes_and_shards_that_are_not_there_are_refused_before_anything_starts() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = folder.path().join("dataset");
    for (options, words) in [
        (["--scenes", "2..9"], "must be A..B within 0..4, or the name of a scene"),
        (["--shard", "2/2"], "must be I/N with I from 0 to N - 1"),
        (["--jobs", "0"], "--jobs is 0, must be in [1, 1024]"),
    ] {
        let output = run(&mut tiny(&dataset, &options));
        assert_eq!(output.status.code(), Some(2), "{options:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(words), "{options:?}: {}", stderr(&output));
    }
    assert!(!dataset.exists());
}
