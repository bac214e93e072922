//! Pages: what each says, in the frame that all have.

use minijinja::Environment;
use minijinja::value::Serde;

use crate::error::{Error, Result};
use crate::report::words;

/// What a report of rendered scenes, or of pictures of one's own, says.
pub(super) const RENDERED: &str = include_str!("html/rendered.html");
/// What a report of drawn junctions says.
pub(super) const DRAWN: &str = include_str!("html/drawn.html");
/// Which method to use.
pub(super) const RECOMMENDATION: &str = include_str!("html/recommendation.html");

/// What became of grasps in physics.
pub(super) const ATTEMPTS: &str = include_str!("html/attempts.html");

/// A page of its content, escaped.
///
/// # Errors
/// When the template asks for what the content has not.
pub(super) fn page(template: &str, content: &serde_json::Value) -> Result<String> {
    let mut environment = Environment::new();
    environment.add_filter("px", |value: Option<f64>| words::px(value));
    environment.add_filter("px3", |value: Option<f64>| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.3}"))
    });
    environment.add_filter("mm", |value: Option<f64>| words::mm(value));
    environment.add_filter("percent", |value: Option<f64>| words::percent(value));
    let templates = [
        ("base.html", include_str!("html/base.html")),
        ("table.html", include_str!("html/table.html")),
        ("page.html", template),
    ];
    let mut render = || {
        for (name, source) in templates {
            environment.add_template(name, source)?;
        }
        environment.get_template("page.html")?.render(Serde(content))
    };
    render().map_err(|error| Error::Other(format!("the page's template: {error:#}")))
}
