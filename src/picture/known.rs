//! Corners that somebody knows: a CSV or JSON file beside the pictures.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};
use crate::geometry::{ImagePoint, Origin};

/// A corner that somebody knows.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownCorner {
    /// Where \[px\].
    pub point: ImagePoint,
    /// Its name, or else its index, if the file has one.
    pub label: Option<String>,
    /// Where it stands in the file: "line 7", for messages.
    pub place: String,
}

/// The known corners of some pictures.
#[derive(Clone, Debug)]
pub struct KnownCorners {
    path: PathBuf,
    /// By picture as the file names it, in its order.
    of_image: BTreeMap<String, Vec<KnownCorner>>,
}

/// One corner as files have it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    image: String,
    x_px: f64,
    y_px: f64,
    #[serde(default)]
    index: Option<u64>,
    #[serde(default)]
    name: Option<String>,
}

/// Columns that must be there, and others that may.
const COLUMNS: [&str; 5] = ["image", "x_px", "y_px", "index", "name"];
const REQUIRED: usize = 3;

impl KnownCorners {
    /// Reads a file.
    ///
    /// CSV (RFC 4180), its first line the names of its columns in any order: `image`, `x_px`, `y_px`, and if need
    /// be `index` and `name`. JSON: an array of objects with these keys, or one object that gives for each image
    /// an array of \[x, y\].
    ///
    /// # Errors
    /// With file, line and column, what was found and what is allowed; NaN and infinities are refused.
    pub fn read(path: &Path, origin: Origin) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(Error::io(path, "read"))?;
        let extension =
            path.extension().map(|text| text.to_ascii_lowercase().to_string_lossy().into_owned());
        let rows = match extension.as_deref() {
            Some("csv") => from_csv(path, &bytes)?,
            Some("json") => from_json(path, &bytes)?,
            other => {
                let found = other.map_or_else(|| "nothing".to_owned(), |text| format!(".{text}"));
                return Err(Error::malformed(
                    path,
                    format!("its name ends in {found}, must end in .csv or .json"),
                ));
            }
        };
        if rows.is_empty() {
            return Err(Error::malformed(path, "holds no corner"));
        }
        let mut of_image: BTreeMap<String, Vec<KnownCorner>> = BTreeMap::new();
        for (place, row) in rows {
            for (key, value) in [("x_px", row.x_px), ("y_px", row.y_px)] {
                if !value.is_finite() {
                    let place = format!("{}: {place}", path.display());
                    return Err(Error::out_of_range(place, key, value, "a finite number"));
                }
            }
            let name = row.name.filter(|name| !name.is_empty());
            let label = name.or_else(|| row.index.map(|index| index.to_string()));
            let point = origin.point([row.x_px, row.y_px]);
            of_image.entry(row.image).or_default().push(KnownCorner { point, label, place });
        }
        Ok(Self { path: path.to_owned(), of_image })
    }

    /// The corners of each of some pictures, none of those that the file does not name. A picture is named by its file
    /// name, or by as many folders before it as tell it from others.
    ///
    /// # Errors
    /// For a name that is neither one of the pictures nor a file beside them or beside this one, with the nearest
    /// name, and for one that is two of them.
    pub fn of_pictures(&self, pictures: &[PathBuf]) -> Result<Vec<Vec<KnownCorner>>> {
        let mut found = vec![Vec::new(); pictures.len()];
        for (name, corners) in &self.of_image {
            let named: Vec<usize> =
                (0..pictures.len()).filter(|&index| pictures[index].ends_with(name)).collect();
            match named[..] {
                [index] => found[index].extend(corners.iter().cloned()),
                [] if self.is_elsewhere(name, pictures) => {}
                [] => return Err(self.unknown(name, &corners[0].place, pictures)),
                [first, second, ..] if pictures[first] != pictures[second] => {
                    let [first, second] = [first, second].map(|index| pictures[index].display());
                    let problem = format!(
                        "{}: image {name:?} is two of the pictures, {first} and {second}; write as many folders \
                         before the name as tell them apart",
                        corners[0].place
                    );
                    return Err(Error::malformed(&self.path, problem));
                }
                // One picture, given twice.
                _ => named.iter().for_each(|&index| found[index].extend(corners.iter().cloned())),
            }
        }
        Ok(found)
    }

    /// Refuses corners that are not in a picture of a size.
    ///
    /// # Errors
    /// For the first of them, with its place, what was found and what is allowed.
    pub fn check_inside(&self, corners: &[KnownCorner], width: usize, height: usize) -> Result<()> {
        for corner in corners {
            let ImagePoint { x, y } = corner.point;
            for (key, value, size) in [("x_px", x, width), ("y_px", y, height)] {
                let most = size as f64 - 0.5;
                if !(-0.5..=most).contains(&value) {
                    let place = format!("{}: {}", self.path.display(), corner.place);
                    let allowed = format!(
                        "in [-0.5, {most}], counted from the first pixel's centre: the picture has {width} x {height} px"
                    );
                    return Err(Error::out_of_range(place, key, value, allowed));
                }
            }
        }
        Ok(())
    }

    /// Whether a name is that of a file which was not asked for this time.
    fn is_elsewhere(&self, name: &str, pictures: &[PathBuf]) -> bool {
        let files = pictures.iter().chain([&self.path]);
        !name.is_empty()
            && files.filter_map(|path| path.parent()).any(|folder| folder.join(name).is_file())
    }

    fn unknown(&self, name: &str, place: &str, pictures: &[PathBuf]) -> Error {
        let mut known: Vec<String> = pictures
            .iter()
            .filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned()))
            .collect();
        known.sort_by_key(|one| strsim::damerau_levenshtein(one, name));
        let more = known.len().saturating_sub(8);
        known.truncate(8);
        if more > 0 {
            known.push(format!("and {more} more"));
        }
        let place = format!("{}: {place}", self.path.display());
        Error::UnknownName { place, kind: "image".into(), found: name.into(), known }
    }
}

fn from_csv(path: &Path, bytes: &[u8]) -> Result<Vec<(String, Row)>> {
    let malformed = |error: csv::Error| Error::malformed(path, error);
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes);
    let header = reader.headers().map_err(malformed)?.clone();
    for (index, column) in header.iter().enumerate() {
        if !COLUMNS.contains(&column) {
            return Err(Error::UnknownName {
                place: format!("{}: line 1", path.display()),
                kind: "column".into(),
                found: column.into(),
                known: COLUMNS.map(str::to_owned).to_vec(),
            });
        }
        if header.iter().take(index).any(|other| other == column) {
            return Err(Error::malformed(path, format!("line 1: column {column} is there twice")));
        }
    }
    let column = |name: &str| header.iter().position(|column| column == name);
    if let Some(missing) = COLUMNS[..REQUIRED].iter().find(|name| column(name).is_none()) {
        let found: Vec<&str> = header.iter().collect();
        let problem = format!(
            "line 1: column {missing} is missing; there are: {}; must be image,x_px,y_px and if need be index,name",
            found.join(", ")
        );
        return Err(Error::malformed(path, problem));
    }
    let mut rows = Vec::new();
    let (mut line, mut counted) = (1, 0);
    for record in reader.records() {
        let record = record.map_err(malformed)?;
        // The reader's own count is behind where lines end in CR LF.
        let begin = record.position().map_or(0, |at| usize::try_from(at.byte()).unwrap_or(0));
        let is_line_end = |byte: &&u8| matches!(byte, b'\r' | b'\n');
        let begin = begin + bytes.iter().skip(begin).take_while(is_line_end).count();
        let passed = bytes.get(counted..begin).unwrap_or_default();
        line += passed.iter().filter(|byte| **byte == b'\n').count();
        counted = begin;
        let place = format!("line {line}");
        let text = |name: &str| column(name).and_then(|at| record.get(at)).unwrap_or_default();
        let refuse = |name: &str, allowed: &str| {
            let found = format!("{:?}", text(name));
            Error::out_of_range(format!("{}: {place}", path.display()), name, found, allowed)
        };
        let number = |name: &str| match text(name).parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(refuse(name, "a finite number with a decimal point")),
        };
        let image = text("image").to_owned();
        if image.is_empty() {
            return Err(refuse("image", "the name of a picture"));
        }
        let index = match (text("index"), text("index").parse()) {
            ("", _) => None,
            (_, Ok(index)) => Some(index),
            _ => return Err(refuse("index", "a whole number, 0 or more")),
        };
        let (x_px, y_px) = (number("x_px")?, number("y_px")?);
        let name = Some(text("name").to_owned());
        rows.push((place, Row { image, x_px, y_px, index, name }));
    }
    Ok(rows)
}

fn from_json(path: &Path, bytes: &[u8]) -> Result<Vec<(String, Row)>> {
    match bytes.iter().find(|byte| !byte.is_ascii_whitespace()) {
        Some(b'[') => {
            let rows: Vec<Row> = json(path, bytes)?;
            Ok(rows.into_iter().enumerate().map(|(at, row)| (format!("[{at}]"), row)).collect())
        }
        Some(b'{') => {
            let of_image: BTreeMap<String, Vec<[f64; 2]>> = json(path, bytes)?;
            let rows = of_image.into_iter().flat_map(|(image, points)| {
                points.into_iter().enumerate().map(move |(at, [x_px, y_px])| {
                    let row = Row { image: image.clone(), x_px, y_px, index: None, name: None };
                    (format!("{image:?}[{at}]"), row)
                })
            });
            Ok(rows.collect())
        }
        _ => {
            let problem = "is no JSON of corners: must be an array of objects with image, x_px, y_px, or an object \
                           that gives for each image an array of [x, y]";
            Err(Error::malformed(path, problem))
        }
    }
}

fn json<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T> {
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    let refuse = |key: String, problem: &dyn Display| {
        let key = if key == "." { String::new() } else { format!("{key}: ") };
        Error::malformed(path, format!("{key}{problem}"))
    };
    let value = serde_path_to_error::deserialize(&mut reader)
        .map_err(|error| refuse(error.path().to_string(), error.inner()))?;
    reader.end().map_err(|error| refuse(".".into(), &error))?;
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, text: impl AsRef<[u8]>) -> std::result::Result<KnownCorners, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("written");
        let known = KnownCorners::read(&path, Origin::default());
        known.map_err(|error| error.chain().replace(&path.display().to_string(), "FILE"))
    }

    fn points(known: &KnownCorners, picture: &str) -> Vec<[f64; 2]> {
        let found = known.of_pictures(&[picture.into()]).expect("known");
        found[0].iter().map(|corner| corner.point.into()).collect()
    }

    #[test]
    fn columns_may_stand_in_any_order_and_be_quoted() {
        let text = "\u{feff}y_px, name,x_px,index,image\r\n2.5,\"top, left\",1.25,3,\"a \"\"b\"\".png\"\r\n4,,3,7,\"a \"\"b\"\".png\"\r\n";
        let known = read("known.csv", text).expect("valid");
        assert_eq!(points(&known, "folder/a \"b\".png"), [[1.25, 2.5], [3.0, 4.0]]);
        let corners = &known.of_image["a \"b\".png"];
        assert_eq!(corners[0].label.as_deref(), Some("top, left"));
        assert_eq!(corners[1].label.as_deref(), Some("7"));
        assert_eq!(corners[1].place, "line 3");
    }

    #[test]
    fn both_forms_of_json_say_the_same() {
        for text in [
            r#"[{"image": "a.png", "x_px": 1, "y_px": 2.5}, {"image": "a.png", "x_px": 3, "y_px": 4, "index": 0}]"#,
            r#" {"a.png": [[1, 2.5], [3, 4]]}"#,
        ] {
            assert_eq!(
                points(&read("known.JSON", text).expect("valid"), "a.png"),
                [[1.0, 2.5], [3.0, 4.0]]
            );
        }
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let head = "image,x_px,y_px\n";
        for (name, text, words) in [
            (
                "a.csv",
                format!("{head}a.png,1,2\na.png,1;5,2\n"),
                &["FILE: line 3: x_px is \"1;5\"", "decimal point"][..],
            ),
            (
                "a.csv",
                format!("{head}a.png,1,nan\n"),
                &["line 2: y_px is \"nan\"", "a finite number"],
            ),
            ("a.csv", format!("{head}a.png,inf,2\n"), &["line 2: x_px is \"inf\""]),
            ("a.csv", format!("{head},1,2\n"), &["line 2: image is \"\""]),
            ("a.csv", format!("{head}a.png,1\n"), &["line: 2", "2 fields"]),
            ("a.csv", head.into(), &["holds no corner"]),
            ("a.csv", String::new(), &["column image is missing"]),
            ("a.csv", "image,x_px\n".into(), &["column y_px is missing; there are: image, x_px"]),
            (
                "a.csv",
                "image,x,y_px\n".into(),
                &["line 1: unknown column \"x\"", "known: image, x_px"],
            ),
            ("a.csv", "image,x_px,x_px\n".into(), &["column x_px is there twice"]),
            (
                "a.csv",
                "image,x_px,y_px,index\na,1,2,-1\n".into(),
                &["line 2: index is \"-1\"", "whole number"],
            ),
            (
                "a.json",
                r#"[{"image": "a", "x_px": 1}]"#.into(),
                &["[0]: missing field `y_px`", "line 1 column"],
            ),
            (
                "a.json",
                r#"[{"image": "a", "x_px": "1"}]"#.into(),
                &["[0].x_px: invalid type", "line 1"],
            ),
            (
                "a.json",
                r#"[{"image": "a", "x_px": 1, "y_px": NaN}]"#.into(),
                &["[0].y_px", "line 1"],
            ),
            ("a.json", r#"[{"image": "a", "x": 1}]"#.into(), &["unknown field `x`", "`x_px`"]),
            ("a.json", "{\"a\": [[1, 2],\n [3]]}".into(), &["a[1]", "line 2"]),
            ("a.json", r#"{"a": [[1e999, 2]]}"#.into(), &["number out of range"]),
            ("a.json", "{} x".into(), &["trailing characters"]),
            ("a.json", "[]".into(), &["holds no corner"]),
            ("a.json", "7".into(), &["is no JSON of corners"]),
            ("a.txt", head.into(), &["ends in .txt, must end in .csv or .json"]),
        ] {
            let error = read(name, &text).expect_err(&text);
            for word in words {
                assert!(error.contains(word), "{text:?}: {word:?} is not in: {error}");
            }
        }
        assert!(
            read("a.csv", b"image,x_px,y_px\n\xff,1,2\n").expect_err("no UTF-8").contains("line")
        );
    }

    #[test]
    fn an_unknown_image_is_named_with_the_nearest() {
        let known = read("a.csv", "image,x_px,y_px\nimg_1.png,1,2\n").expect("valid");
        let error = known.of_pictures(&["x/img_01.png".into(), "x/other.png".into()]);
        let error = error.expect_err("unknown").to_string();
        assert!(
            error.contains("line 2: unknown image \"img_1.png\"; did you mean \"img_01.png\"?"),
            "{error}"
        );
        let twice = known.of_pictures(&["a/img_1.png".into(), "b/img_1.png".into()]);
        assert!(twice.expect_err("two").to_string().contains("is two of the pictures"));
        let same = known.of_pictures(&["a/img_1.png".into(), "a/img_1.png".into()]).expect("one");
        assert_eq!(same[0], same[1]);
    }

    #[test]
    fn corners_outside_a_picture_are_refused() {
        let known = read("a.csv", "image,x_px,y_px\na.png,-0.5,2\na.png,3,9.6\n").expect("valid");
        let corners = &known.of_image["a.png"];
        assert!(known.check_inside(corners, 4, 11).is_ok());
        let error = known.check_inside(corners, 4, 10).expect_err("outside").to_string();
        assert!(error.contains("line 3: y_px is 9.6, must be in [-0.5, 9.5]"), "{error}");
    }

    #[test]
    fn origins_differ_by_half_a_pixel() {
        let points = Origin::ALL.map(|origin| origin.point([1.0, 2.0]).x);
        assert_eq!(points.map(f64::to_bits), [1.0_f64, 0.5, 0.0].map(f64::to_bits));
    }

    proptest::proptest! {
        #[test]
        fn no_bytes_are_a_panic(bytes: Vec<u8>) {
            let path = Path::new("any");
            let _ = (from_csv(path, &bytes), from_json(path, &bytes));
            let text = [b"image,x_px,y_px\n", &bytes[..]].concat();
            let _ = from_csv(path, &text);
        }
    }
}
