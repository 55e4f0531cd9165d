//! The variants that are compared.

use super::compare::{Join, Rule, SignOf, Strata, Term, Variant};
use super::measures::Measure;
use crate::tissue::Bias;

const SHARPNESS: Measure = sharpness(0.65, 2.5);
const DETAIL: Measure = detail([0.5, 1.2], 2.0);

const fn sharpness(gradient_mm: f64, window_mm: f64) -> Measure {
    Measure::Sharpness {
        gradient_mm,
        window_mm,
    }
}

const fn detail(band_mm: [f64; 2], window_mm: f64) -> Measure {
    Measure::Detail { band_mm, window_mm }
}

const fn white(window_mm: f64) -> Measure {
    Measure::White { window_mm }
}

const fn tissue(window_mm: f64) -> Measure {
    Measure::Tissue { window_mm }
}

fn term(measure: Measure) -> Term {
    Term {
        measure,
        ring_mm: 8.0,
        mirrored_mm: 3.0,
        is_warped: false,
        strata: Strata::Whole,
    }
}

/// The lesser of both comparisons of a weighted sum of measures.
fn of(measures: &[(Measure, f32)]) -> SignOf {
    let terms = measures
        .iter()
        .map(|(measure, weight)| (term(*measure), *weight));
    SignOf {
        terms: terms.collect(),
        rule: Rule::Least,
    }
}

/// The present definition of `blur`, with changed terms.
fn blur(change: impl Fn(&mut Term)) -> SignOf {
    let mut sign = of(&[(DETAIL, -0.7), (SHARPNESS, -0.3)]);
    sign.terms.iter_mut().for_each(|(term, _)| change(term));
    sign
}

fn by_rule(rule: Rule, sign: SignOf) -> SignOf {
    SignOf { rule, ..sign }
}

fn one(name: impl Into<String>, sign: SignOf) -> Variant {
    joined(name, Join::Greatest, vec![sign])
}

fn joined(name: impl Into<String>, join: Join, signs: Vec<SignOf>) -> Variant {
    Variant {
        name: name.into(),
        signs,
        join,
        candidate_mm: 2.0,
        prior: 0.05,
    }
}

/// The variants of a family, the present definition first, and the bias field for all of them.
pub(super) fn named(family: &str) -> Option<(Vec<Variant>, Bias)> {
    let mut bias = Bias::STANDARD;
    let more = match family {
        "present" => Vec::new(),
        "one pass" => {
            bias = ONE_PASS;
            vec![Variant {
                prior: 0.0,
                ..one("as before", blur(|_| ()))
            }]
        }
        "three passes" => {
            bias.passes = &[(20.0, 0.5); 3];
            Vec::new()
        }
        "all white matter" => {
            bias.passes = &[(20.0, 0.5); 5];
            Vec::new()
        }
        "narrow passes" => {
            bias.passes = &[
                (20.0, 0.6),
                (20.0, 0.6),
                (20.0, 0.6),
                (12.0, 0.6),
                (12.0, 0.6),
                (12.0, 0.6),
            ];
            Vec::new()
        }
        "rings" => rings(),
        "smoothing" => smoothing(),
        "rules" => rules(),
        "scales" => scales(),
        "warp" => warp(),
        "signs" => signs(),
        "joined" => two_signs(),
        "third term" => third_term().into(),
        _ => return None,
    };
    let mut variants = vec![one("present", blur(|_| ()))];
    variants.extend(more);
    Some((variants, bias))
}

/// The bias field of earlier versions.
const ONE_PASS: Bias = Bias {
    passes: &[(20.0, 0.5)],
};

fn rings() -> Vec<Variant> {
    let ring = |ring_mm| {
        let sign = blur(|term| term.ring_mm = ring_mm);
        one(format!("surroundings {ring_mm} mm"), sign)
    };
    let mirror = |mirrored_mm| {
        let sign = blur(|term| term.mirrored_mm = mirrored_mm);
        one(format!("mirrored side {mirrored_mm} mm"), sign)
    };
    let mut variants: Vec<Variant> = [6.0, 10.0, 12.0].map(ring).into();
    variants.extend([2.0, 4.0, 5.0].map(mirror));
    variants
}

fn smoothing() -> Vec<Variant> {
    let smoothed = |candidate_mm| Variant {
        candidate_mm,
        ..one(format!("smoothed by {candidate_mm} mm"), blur(|_| ()))
    };
    let prior = |prior| Variant {
        prior,
        ..one(format!("weight of 0: {prior}"), blur(|_| ()))
    };
    let mut variants: Vec<Variant> = [1.5, 2.5].map(smoothed).into();
    variants.extend([0.0, 0.02, 0.1, 0.2].map(prior));
    variants
}

fn rules() -> Vec<Variant> {
    let strata = |(name, strata)| one(name, blur(|term| term.strata = strata));
    let rule = |(name, rule)| one(name, by_rule(rule, blur(|_| ())));
    let mut variants: Vec<Variant> = [
        ("z by depth", Strata::Depth),
        ("z by junction around", Strata::Density),
        ("z by white matter around", Strata::White),
    ]
    .map(strata)
    .into();
    variants.extend(
        [
            ("mean of both", Rule::Mean),
            ("surroundings only", Rule::Ring),
            ("mirrored side only", Rule::Mirror),
            ("three quarters of the lesser", Rule::Soft),
        ]
        .map(rule),
    );
    variants
}

fn scales() -> Vec<Variant> {
    let share = |share: f32| {
        let sign = of(&[(DETAIL, -share), (SHARPNESS, share - 1.0)]);
        one(format!("share of detail {share}"), sign)
    };
    let both = |name, detail, sharpness| one(name, of(&[(detail, -0.7), (sharpness, -0.3)]));
    let coarse = || of(&[(detail([0.8, 2.0], 2.0), -0.7), (sharpness(1.0, 2.5), -0.3)]);
    let two = |name, join| joined(name, join, vec![blur(|_| ()), coarse()]);
    let mut variants: Vec<Variant> = [0.5, 1.0].map(share).into();
    variants.extend([
        both("detail 0.4 to 1 mm", detail([0.4, 1.0], 2.0), SHARPNESS),
        both("detail 0.6 to 1.5 mm", detail([0.6, 1.5], 2.0), SHARPNESS),
        both("detail over 1.5 mm", detail([0.5, 1.2], 1.5), SHARPNESS),
        both("sharpness over 1.8 mm", DETAIL, sharpness(0.65, 1.8)),
        two("two scales, greatest", Join::Greatest),
        two("two scales, least", Join::Least),
        two("two scales, sum", Join::Sum),
    ]);
    variants
}

fn warp() -> Vec<Variant> {
    let warped = |mirrored_mm| {
        let sign = blur(|term| {
            term.is_warped = true;
            term.mirrored_mm = mirrored_mm;
        });
        one(format!("displaced, mirrored side {mirrored_mm} mm"), sign)
    };
    [2.0, 3.0].map(warped).into()
}

fn signs() -> Vec<Variant> {
    let thickness = |window_mm| Measure::Thickness { window_mm };
    let thick = |window_mm| {
        one(
            format!("thickness over {window_mm} mm"),
            of(&[(thickness(window_mm), 1.0)]),
        )
    };
    let mut variants: Vec<Variant> = [2.0, 3.0].map(thick).into();
    variants.extend([
        one(
            "thickness over 3 mm, surroundings only",
            by_rule(Rule::Ring, of(&[(thickness(3.0), 1.0)])),
        ),
        one(
            "thickness over 3 mm, mirrored side only",
            by_rule(Rule::Mirror, of(&[(thickness(3.0), 1.0)])),
        ),
        one("all tissue over 3 mm", of(&[(tissue(3.0), -1.0)])),
        one("white matter over 3 mm", of(&[(white(3.0), -1.0)])),
        one(
            "thickness and all tissue",
            of(&[(thickness(3.0), 0.7), (tissue(3.0), -0.5)]),
        ),
    ]);
    variants
}

fn two_signs() -> Vec<Variant> {
    let thickness = || of(&[(Measure::Thickness { window_mm: 3.0 }, 1.0)]);
    let dark = || of(&[(white(3.0), -1.0)]);
    let with = |name, join, sign| joined(name, join, vec![blur(|_| ()), sign]);
    vec![
        with(
            "greatest of blur and thickness",
            Join::Greatest,
            thickness(),
        ),
        with("sum of blur and thickness", Join::Sum, thickness()),
        with("greatest of blur and white matter", Join::Greatest, dark()),
        with("sum of blur and white matter", Join::Sum, dark()),
        joined(
            "sum of all three",
            Join::Sum,
            vec![blur(|_| ()), thickness(), dark()],
        ),
    ]
}

fn third_term() -> [Variant; 2] {
    [
        one(
            "white matter as a third term",
            of(&[(DETAIL, -0.6), (SHARPNESS, -0.25), (white(3.0), -0.3)]),
        ),
        one(
            "all tissue as a third term",
            of(&[(DETAIL, -0.7), (SHARPNESS, -0.3), (tissue(3.0), -0.3)]),
        ),
    ]
}
