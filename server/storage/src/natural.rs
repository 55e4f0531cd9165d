//! The natural order of labels.

/// A key whose bytes sort as people do: `Case 2` before `case 10`.
///
/// Letters are in lower case. Before each number stands how many digits it has, so that a longer one follows.
pub(crate) fn natural_key(label: &str) -> String {
    let label = label.to_lowercase();
    let mut key = String::with_capacity(label.len() + 8);
    let mut rest = label.as_str();
    while let Some(start) = rest.find(|letter: char| letter.is_ascii_digit()) {
        let (words, number) = rest.split_at(start);
        let end = number.find(|letter: char| !letter.is_ascii_digit());
        let (digits, after) = number.split_at(end.unwrap_or(number.len()));
        let digits = digits.trim_start_matches('0');
        key.push_str(words);
        key.push_str(&format!("{:03}{digits}", digits.len()));
        rest = after;
    }
    key.push_str(rest);
    key
}

#[cfg(test)]
mod tests {
    use super::natural_key;

    #[test]
    fn numbers_are_sorted_by_their_value_and_letters_in_either_case() {
        let sorted = [
            "12",
            "100 heads",
            "Case 2",
            "case 2b",
            "case 10",
            "CASE 10.9",
            "case 10.11",
            "case 1000000000000000000000000000000",
            "case a",
            "Zoé",
        ];
        let keys = sorted.map(natural_key);
        assert!(keys.is_sorted(), "{keys:?}");
        assert_eq!(natural_key("Head 007"), natural_key("head 7"));
        assert_ne!(natural_key("head 0"), natural_key("head"));
        assert_eq!(natural_key(""), "");
    }
}
