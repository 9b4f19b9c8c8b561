//! Text from outside that people will read.

/// Longest name of a scene, a light or a client, characters.
pub const MAX_NAME: usize = 128;

/// Drops control characters and the marks that reorder text on screen, and cuts at [`MAX_NAME`] characters.
pub fn clean_name(name: &str) -> String {
    let is_plain = |c: &char| {
        !c.is_control()
            && !matches!(c, '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
    };
    name.trim().chars().filter(is_plain).take(MAX_NAME).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misleading_characters_are_dropped() {
        assert_eq!(clean_name("  a\u{202e}gnp.exe\n\u{0}b "), "agnp.exeb");
        assert_eq!(clean_name(&"x".repeat(1000)).len(), MAX_NAME);
    }
}
