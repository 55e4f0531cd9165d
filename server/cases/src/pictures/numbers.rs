//! Lists of numbers in texts.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Numbers with commas between them, such as `0,0,0,1`: exactly `N`, all finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Numbers<const N: usize>(pub [f64; N]);

impl<const N: usize> Serialize for Numbers<N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0)
    }
}

/// From a text with commas, as in addresses, or from a list, as in JSON.
impl<'de, const N: usize> Deserialize<'de> for Numbers<N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NumbersVisitor)
    }
}

struct NumbersVisitor<const N: usize>;

impl<'de, const N: usize> serde::de::Visitor<'de> for NumbersVisitor<N> {
    type Value = Numbers<N>;

    fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{N} finite numbers")
    }

    fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Self::Value, E> {
        text.parse().map_err(E::custom)
    }

    fn visit_seq<A: serde::de::SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
        let mut numbers = [0.0; N];
        for (index, number) in numbers.iter_mut().enumerate() {
            let next = list.next_element()?;
            *number = next.ok_or_else(|| A::Error::invalid_length(index, &self))?;
        }
        match list.next_element::<f64>()? {
            None => Ok(Numbers(numbers)),
            Some(_) => Err(A::Error::invalid_length(N + 1, &self)),
        }
    }
}

impl<const N: usize> std::str::FromStr for Numbers<N> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = numbers(text).ok_or("these are not finite numbers with commas")?;
        let count = numbers.len();
        let numbers = numbers.try_into();
        numbers
            .map(Self)
            .map_err(|_| format!("{N} numbers with commas are required, not {count}"))
    }
}

fn numbers(text: &str) -> Option<Vec<f64>> {
    let number = |part: &str| part.trim().parse().ok().filter(|x: &f64| x.is_finite());
    text.split(',').map(number).collect()
}

/// Numbers with commas between them, any number of them, all finite.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[serde(transparent)]
pub struct NumberList(pub Vec<f64>);

impl<'de> Deserialize<'de> for NumberList {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = <std::borrow::Cow<'de, str>>::deserialize(deserializer)?;
        let numbers = numbers(&text);
        let error = || D::Error::custom("these are not finite numbers with commas");
        numbers.map(Self).ok_or_else(error)
    }
}
