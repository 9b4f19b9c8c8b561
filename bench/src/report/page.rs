//! Pages of docs/bench: prose from a template, tables from what was measured.

use surfelcast::Failure;

/// A page and its template, in which `{{part}}` on a line of its own stands for what is measured.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Page {
    /// Name of the study and, with the ending `.md`, of the file.
    pub(crate) name: &'static str,
    pub(crate) template: &'static str,
}

impl Page {
    /// The page with its parts in place. Every part of the template must be there.
    pub(crate) fn fill(&self, parts: &[(&str, String)]) -> Result<String, Failure> {
        let mut text = String::new();
        for line in self.template.lines() {
            match placeholder(line) {
                None => text += line,
                Some(part) => {
                    let found = parts.iter().find(|(name, _)| *name == part);
                    let missing = || Failure::runtime(format!("page {}: there is no part {part}", self.name));
                    text += &wrapped(found.ok_or_else(missing)?.1.trim_end());
                }
            }
            text.push('\n');
        }
        Ok(text)
    }
}

/// Columns at which prose is wrapped.
const COLUMNS: usize = 118;

/// The text with its prose wrapped; tables keep their lines.
fn wrapped(text: &str) -> String {
    let mut lines = Vec::new();
    for line in text.lines() {
        if line.starts_with('|') {
            lines.push(line.to_owned());
            continue;
        }
        let mut current = String::new();
        for word in line.split(' ') {
            if !current.is_empty() && current.len() + word.len() >= COLUMNS {
                lines.push(std::mem::take(&mut current));
            }
            if !current.is_empty() {
                current.push(' ');
            }
            current += word;
        }
        lines.push(current);
    }
    lines.join("\n")
}

/// The part for which a line of a template stands.
fn placeholder(line: &str) -> Option<&str> {
    line.strip_prefix("{{")?.strip_suffix("}}")
}

/// Targets of the links and images of a document.
pub(crate) fn links(text: &str) -> impl Iterator<Item = &str> {
    text.split("](").skip(1).filter_map(|rest| rest.split([')', ' ']).next())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::PAGES;

    #[test]
    fn parts_stand_where_the_template_has_them() {
        let page = Page { name: "x", template: "# X\n\n{{one}}\n\nend\n" };
        assert_eq!(page.fill(&[("one", "| a |\n\n".to_owned())]).unwrap(), "# X\n\n| a |\n\nend\n");
        assert!(page.fill(&[("two", String::new())]).is_err());
        assert_eq!(links("[a](b.md) ![c](d.svg \"t\")").collect::<Vec<_>>(), ["b.md", "d.svg"]);
    }

    #[test]
    fn prose_is_wrapped_and_tables_are_not() {
        let row = format!("| {} |", "x y ".repeat(60));
        let text = wrapped(&format!("{}\n\n{row}", "word ".repeat(40).trim_end()));
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines.len() == 4 && lines[0].len() <= COLUMNS && lines[2].is_empty() && lines[3] == row, "{text}");
    }

    /// The prose of each page is edited in its template; the page in docs/bench follows.
    #[test]
    fn pages_show_the_prose_of_their_templates() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/bench");
        for page in PAGES {
            let path = folder.join(page.name).with_extension("md");
            let shown = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            let mut rest = shown.as_str();
            for line in page.template.lines().filter(|line| placeholder(line).is_none()) {
                let found = rest.split_once(&format!("{line}\n"));
                rest = found.unwrap_or_else(|| panic!("{}: the template says `{line}`", path.display())).1;
            }
        }
    }
}
