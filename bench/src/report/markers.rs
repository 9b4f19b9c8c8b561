//! Tables inside documents.

use surfelcast::Failure;

/// Replaces what stands between `<!-- name: begin -->` and `<!-- name: end -->`.
pub(crate) fn replace_between_markers(document: &str, name: &str, content: &str) -> Result<String, Failure> {
    let (begin, end) = (format!("<!-- {name}: begin -->"), format!("<!-- {name}: end -->"));
    let (head, rest) =
        document.split_once(&begin).ok_or_else(|| Failure::input(format!("the document has no {begin}")))?;
    let (_, tail) = rest.split_once(&end).ok_or_else(|| Failure::input(format!("the document has no {end}")))?;
    Ok(format!("{head}{begin}\n{content}{end}{tail}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markers_enclose_what_is_replaced() -> Result<(), Failure> {
        let document = "a\n<!-- x: begin -->\nold\n<!-- x: end -->\nb\n";
        let once = replace_between_markers(document, "x", "new\n")?;
        assert_eq!(once, "a\n<!-- x: begin -->\nnew\n<!-- x: end -->\nb\n");
        assert_eq!(replace_between_markers(&once, "x", "new\n")?, once);
        assert!(replace_between_markers(document, "y", "").is_err());
        Ok(())
    }
}
