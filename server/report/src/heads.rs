//! A page of many heads, each with a picture and a link to its report.

use maud::{DOCTYPE, PreEscaped, html};
use render::RESEARCH_USE_NOTICE;

const STYLE: &str = "\
body { font: 15px/1.4 system-ui, sans-serif; margin: 1.5rem; color: #222; background: #fff }
main { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: 1rem }
article { border: 1px solid #ccc; border-radius: 4px; padding: .6rem; overflow-wrap: anywhere }
article.other { border-color: #b30 } h2 { font-size: 1rem; margin: .3rem 0 } p { margin: .2rem 0 }
img { width: 100%; aspect-ratio: 1; background: #000 } small { color: #555 } .doubt { color: #b30 }";

/// Pictures lie beside the page, in files or on a server.
const POLICY: &str = "default-src 'none'; img-src 'self' file:; style-src 'unsafe-inline'";

/// A head of the page. Addresses are relative.
#[derive(Debug, Clone, Default)]
pub struct ListedHead {
    pub name: String,
    /// `done`, `refused`, `failed` or `pending`.
    pub state: &'static str,
    pub picture: Option<String>,
    pub report: Option<String>,
    /// What is known of it, a line each.
    pub lines: Vec<String>,
    /// What is doubtful or wrong, in sentences.
    pub doubts: Vec<String>,
}

/// The page, which needs no script. Names of files and texts of errors are escaped.
pub fn page_of_heads(title: &str, heads: &[ListedHead]) -> String {
    let count = |state: &str| heads.iter().filter(|head| head.state == state).count();
    let [done, refused, failed, pending] = ["done", "refused", "failed", "pending"].map(count);
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (title) }
                p { (done) " done, " (refused) " refused, " (failed) " failed, " (pending) " pending." }
                p { small { (RESEARCH_USE_NOTICE) } }
                main { @for head in heads {
                    article.other[head.state != "done"] {
                        @if let Some(picture) = &head.picture {
                            a href=[head.report.as_ref()] { img src=(picture) alt={ "The cut of " (head.name) } loading="lazy"; }
                        }
                        h2 { @match &head.report {
                            Some(report) => a href=(report) { (head.name) },
                            None => (head.name),
                        } }
                        @if head.state != "done" { p { strong { (head.state) } } }
                        @for line in &head.lines { p { (line) } }
                        @for doubt in &head.doubts { p.doubt { (doubt) } }
                    }
                } }
            }
        }
    };
    page.into_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_reasons_are_text_and_nothing_else() {
        let done = ListedHead {
            name: "sub-<b>1".to_owned(),
            state: "done",
            picture: Some("sub-1/figures/a.png".to_owned()),
            report: Some("sub-1.html\" onclick=\"x".to_owned()),
            lines: vec!["mask: ok".to_owned()],
            doubts: vec!["<script>".to_owned()],
        };
        let refused = ListedHead {
            state: "refused",
            ..ListedHead::default()
        };
        let page = page_of_heads("Heads", &[done, refused]);
        assert!(
            page.contains("sub-&lt;b&gt;1") && page.contains("&lt;script&gt;"),
            "{page}"
        );
        assert!(
            page.contains("href=\"sub-1.html&quot; onclick=&quot;x\""),
            "{page}"
        );
        assert!(
            page.contains("1 done, 1 refused, 0 failed, 0 pending."),
            "{page}"
        );
        assert!(!page.contains("<script") && page.contains("Not for diagnosis"));
    }
}
