//! The notice of everything that the project shows or writes.

/// The notice. Every PNG has it as its text `Disclaimer`.
pub const RESEARCH_USE_NOTICE: &str = "For research use only. Not for diagnosis.";

/// The notice for places without room for [`RESEARCH_USE_NOTICE`]: annotated pictures and the header of an STL file.
pub const SHORT_NOTICE: &str = "research use only";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_short_notice_is_a_part_of_the_long_one() {
        assert!(RESEARCH_USE_NOTICE.contains(SHORT_NOTICE));
    }
}
