//! A run's records method by method: never all of them at once.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::error::Result;
use crate::record::{Record, RecordFile, kind, status};
use crate::report::summary::Unreadable;

/// About so many records are held at once, a fifth of a gigabyte, unless a single method has more.
const MOST: usize = 80_000;

/// What is read to know who is there.
const NAMES: [&str; 7] =
    ["record_version", "scene", "camera", "method", "kind", "status", "reason"];

/// The records of one run.
pub(super) struct RunRecords {
    path: PathBuf,
    groups: usize,
    methods: Vec<Rows>,
    /// Scenes that could not be read, each with its reason.
    pub unreadable: Vec<Unreadable>,
}

/// The rows of a camera and method.
#[derive(Clone, Debug, PartialEq)]
struct Rows {
    camera: String,
    method: String,
    count: usize,
}

impl RunRecords {
    /// Opens a file of records, and finds who is there.
    ///
    /// # Errors
    /// When the file is missing, not Parquet, or its columns are another version's.
    pub fn open(path: &Path) -> Result<Self> {
        let groups = RecordFile::open(path)?.groups();
        let (mut methods, mut unreadable) = (Vec::new(), Vec::new());
        for mut found in read(path, groups, Found::of)? {
            unreadable.append(&mut found.unreadable);
            for rows in found.methods {
                add(&mut methods, rows);
            }
        }
        Ok(Self { path: path.to_owned(), groups, methods, unreadable })
    }

    /// The cameras, each once.
    pub fn cameras(&self) -> Vec<&str> {
        let mut cameras: Vec<&str> = Vec::new();
        for rows in &self.methods {
            if !cameras.contains(&rows.camera.as_str()) {
                cameras.push(&rows.camera);
            }
        }
        cameras
    }

    /// Calls `f` with the rows of each camera and method, in the order in which they come.
    ///
    /// # Errors
    /// When the file cannot be read, and those of `f`.
    pub fn for_each_method(&self, f: impl FnMut(&[&Record]) -> Result<()>) -> Result<()> {
        self.for_each_method_of(MOST, f)
    }

    /// The same, about `most` rows at a time.
    fn for_each_method_of(
        &self,
        most: usize,
        mut f: impl FnMut(&[&Record]) -> Result<()>,
    ) -> Result<()> {
        for batch in batches(&self.methods, most) {
            let place = |camera: &str, method: &str| {
                batch.iter().position(|rows| (&*rows.camera, &*rows.method) == (camera, method))
            };
            let mut records: Vec<Vec<Record>> =
                batch.iter().map(|rows| Vec::with_capacity(rows.count)).collect();
            let is_wanted = |camera: &str, method: &str| place(camera, method).is_some();
            let groups =
                read(&self.path, self.groups, |file, group| file.read_where(group, &[], is_wanted));
            for group in groups? {
                for record in group.into_iter().filter(is_scored) {
                    if let Some(place) = place(&record.camera, &record.method) {
                        records[place].push(record);
                    }
                }
            }
            for rows in &records {
                f(&rows.iter().collect::<Vec<_>>())?;
            }
        }
        Ok(())
    }
}

/// Who is there in a group.
#[derive(Default)]
struct Found {
    methods: Vec<Rows>,
    unreadable: Vec<Unreadable>,
}

impl Found {
    fn of(file: &RecordFile, group: usize) -> Result<Self> {
        let mut found = Self::default();
        for record in file.read(group, &NAMES)? {
            if record.kind == kind::SCENE {
                let reason = record.reason.unwrap_or_default();
                found.unreadable.push(Unreadable { scene: record.scene, reason });
            } else if is_scored(&record) {
                let Record { camera, method, .. } = record;
                add(&mut found.methods, Rows { camera, method, count: 1 });
            }
        }
        Ok(found)
    }
}

fn add(methods: &mut Vec<Rows>, more: Rows) {
    let is_its = |rows: &&mut Rows| (&rows.camera, &rows.method) == (&more.camera, &more.method);
    match methods.iter_mut().find(is_its) {
        Some(rows) => rows.count += more.count,
        None => methods.push(more),
    }
}

/// Reads groups in parallel; each thread has a place of its own in the file.
pub(super) fn read<T: Send>(
    path: &Path,
    groups: usize,
    read: impl Fn(&RecordFile, usize) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    (0..groups)
        .into_par_iter()
        .map_init(
            || RecordFile::open(path),
            |file, group| match file {
                Ok(file) => read(file, group),
                // Said again, by an error of its own.
                Err(_) => RecordFile::open(path).and_then(|file| read(&file, group)),
            },
        )
        .collect()
}

/// Whether a row is of a method's answers, and something is known of them.
pub(super) fn is_scored(record: &Record) -> bool {
    ![kind::SCENE, kind::FAILURE].contains(&record.kind.as_str())
        && record.status != status::UNKNOWN
}

/// As many at a time as have no more than `most` rows, and at least one.
fn batches(methods: &[Rows], most: usize) -> Vec<&[Rows]> {
    let (mut batches, mut rest) = (Vec::new(), methods);
    while !rest.is_empty() {
        let mut sum = 0;
        let fits = |rows: &&Rows| {
            sum += rows.count;
            sum <= most
        };
        let (batch, others) = rest.split_at(rest.iter().take_while(fits).count().max(1));
        batches.push(batch);
        rest = others;
    }
    batches
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{RECORD_VERSION, write_records};

    #[test]
    fn batches_hold_every_method_once_and_no_more_rows_than_allowed() {
        let rows = |count: usize| Rows { camera: "c".into(), method: count.to_string(), count };
        let methods: Vec<Rows> = [3, 4, 9, 20, 1, 2, 7].map(rows).to_vec();
        let counts: Vec<Vec<usize>> = batches(&methods, 10)
            .iter()
            .map(|batch| batch.iter().map(|rows| rows.count).collect())
            .collect();
        assert_eq!(counts, [vec![3, 4], vec![9], vec![20], vec![1, 2, 7]]);
        assert!(batches(&[], 10).is_empty());
    }

    #[test]
    fn each_method_comes_with_its_own_rows_and_what_could_not_be_read_apart() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("records.parquet");
        let row = |scene: &str, method: &str, kind: &str, status: &str| Record {
            record_version: RECORD_VERSION,
            scene: scene.into(),
            camera: "ideal".into(),
            method: method.into(),
            kind: kind.into(),
            status: status.into(),
            reason: Some("lost".into()),
            ..Record::default()
        };
        let records = [
            row("a", "x", kind::CORNER, status::OK),
            row("a", "y", kind::CORNER, status::OK),
            row("a", "y", kind::CORNER, status::UNKNOWN),
            row("b", "", kind::SCENE, status::OK),
            row("c", "x", kind::CORNER, status::MISSED),
        ];
        write_records(&path, &records).expect("written");
        let run = RunRecords::open(&path).expect("a run");
        assert_eq!(run.unreadable.len(), 1);
        assert_eq!((&*run.unreadable[0].scene, &*run.unreadable[0].reason), ("b", "lost"));
        assert_eq!(run.cameras(), ["ideal"]);
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        // Once through the file, and once for each method.
        for most in [MOST, 1] {
            let mut found = Vec::new();
            run.for_each_method_of(most, |rows| {
                let scenes: Vec<String> = rows.iter().map(|row| row.scene.clone()).collect();
                found.push((rows[0].method.clone(), scenes));
                Ok(())
            })
            .expect("rows");
            assert_eq!(
                found,
                [("x".to_owned(), names(&["a", "c"])), ("y".to_owned(), names(&["a"]))]
            );
        }
    }
}
