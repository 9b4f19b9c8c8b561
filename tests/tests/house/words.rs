//! The words of comments, names and documents: one term for one thing, the field's own. And the length of their lines.

use anyhow::Result;

use crate::report;
use crate::sources::{CODE, Source, sources};

/// Refused words and what to write instead; see the glossary of CONTRIBUTING.md.
const REFUSED: &[(&str, &str)] = &[
    ("newborn", "new"),
    ("unborn", "not yet spawned"),
    ("living surfel", "live surfel"),
    ("living surfels", "live surfels"),
    ("comes upon", "newly visible surface"),
    ("came upon", "newly visible surface"),
    ("come upon", "newly visible surface"),
    ("new ground", "newly visible surface"),
    ("has the turn", "the budget goes to"),
    ("for the eye", "primary lookup"),
    ("anew", "again"),
    ("so many", "the number by its name"),
    ("of such", "the quantity by its name"),
    ("is asked for", "is requested"),
    ("asked for", "requested"),
    ("asks for", "requests"),
    ("let go", "evict, release"),
    ("lets go", "evicts, releases"),
    ("knob", "setting"),
    ("knobs", "settings"),
    ("wishes", "settings"),
    ("manners", "behaviour"),
    ("obey", "handle"),
    ("obeys", "handles"),
    ("unfiled", "not yet inserted"),
];

/// Longest line of a comment or of a document's text, columns.
const COLUMNS: usize = 120;

/// The text of a line without the marks of a comment.
fn text_of(line: &str) -> &str {
    line.trim_start().trim_start_matches(['/', '!', '*', '#', '-', '>']).trim()
}

/// Whether `word` stands at `at` as a word of its own, also between the underscores of a name.
fn is_whole(text: &str, at: usize, word: &str) -> bool {
    let before = text[..at].chars().next_back();
    let after = text[at + word.len()..].chars().next();
    !before.is_some_and(char::is_alphanumeric) && !after.is_some_and(char::is_alphanumeric)
}

/// Refused words of a text, with the numbers of their lines. A phrase may go on in the next line.
fn refused_words(text: &str) -> Vec<(usize, &'static str, &'static str)> {
    let lines: Vec<String> = text.lines().map(|line| text_of(line).to_lowercase()).collect();
    let mut found = Vec::new();
    for (index, line) in lines.iter().enumerate() {
        let next = lines.get(index + 1).map_or("", String::as_str);
        let joined = format!("{line} {next}");
        for (word, better) in REFUSED {
            let starts_here = |(at, _): &(usize, &str)| *at < line.len() && is_whole(&joined, *at, word);
            found.extend(joined.match_indices(word).filter(starts_here).map(|_| (index + 1, *word, *better)));
        }
    }
    found
}

#[test]
fn words_are_the_fields_own() -> Result<()> {
    let mut faults = Vec::new();
    // This file names the words.
    for source in sources()?.iter().filter(|source| source.path != "tests/tests/house/words.rs") {
        for (line, word, better) in refused_words(&source.text) {
            let message =
                format!("{}:{line}: \"{word}\" is refused; write: {better} (CONTRIBUTING.md, Glossary)", source.path);
            faults.push(message);
        }
    }
    report(&faults)
}

/// Numbers of the lines that are too long: comments of code, text of documents. Not tables, blocks of code, or lines
/// with an address, which cannot be broken.
fn long_lines(source: &Source) -> Vec<usize> {
    let is_document = source.is(&["md"]);
    let mut is_block = false;
    let mut found = Vec::new();
    for (index, line) in source.text.lines().enumerate() {
        let start = line.trim_start();
        if is_document && start.starts_with("```") {
            is_block = !is_block;
        }
        let is_text = if is_document {
            !is_block && !start.starts_with('|')
        } else {
            (start.starts_with("//") && !text_of(line).starts_with('|'))
                || start.starts_with("* ")
                || start.starts_with("/*")
                || start.starts_with("# ")
        };
        if is_text && line.chars().count() > COLUMNS && !line.contains("://") {
            found.push(index + 1);
        }
    }
    found
}

#[test]
fn lines_of_text_are_short() -> Result<()> {
    let mut faults = Vec::new();
    for source in sources()?.iter().filter(|source| source.is(CODE) || source.is(&["md"])) {
        for line in long_lines(source) {
            let message = format!("{}:{line}: over {COLUMNS} columns; break the line", source.path);
            faults.push(message);
        }
    }
    report(&faults)
}

#[test]
fn the_check_of_words_sees_what_it_should() {
    let words = |text| refused_words(text).into_iter().map(|(line, word, _)| (line, word)).collect::<Vec<_>>();
    assert_eq!(words("let newborn_count = 0;\n// Laid\n// anew."), [(1, "newborn"), (3, "anew")]);
    assert_eq!(words("/// Rays for so\n/// many surfels."), [(1, "so many")]);
    assert_eq!(words("a doorknob, renewal, wished"), []);
}
