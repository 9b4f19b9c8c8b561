//! Identifiers that cannot be guessed.

/// Random identifier: 32 hex digits from the operating system's generator.
pub(crate) fn random_id() -> Result<String, getrandom::Error> {
    let mut bytes = [0u8; 16];
    getrandom::fill(&mut bytes)?;
    Ok(hex::encode(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_differ() {
        assert_ne!(random_id().ok(), random_id().ok());
    }
}
