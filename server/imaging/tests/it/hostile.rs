//! Damaged files never panic and never make the reader allocate beyond its limits.

use imaging::{Limits, nifti, sniff};
use proptest::collection::vec;
use proptest::prelude::*;

use crate::builder::*;

/// The most bytes that this thread held at once during `work`, beyond what it held before.
fn peak_bytes(work: impl FnOnce()) -> usize {
    allocation_counter::measure(work).bytes_max as usize
}

/// A buffer of 256 KiB, and the state of the decoder.
const OVERHEAD_BYTES: usize = 512 << 10;

const LIMITS: Limits = Limits {
    max_voxels: 1 << 20,
    max_bytes: 4 << 20,
};

/// What a list that doubles may hold while it moves: two bytes a voxel, and half of that again.
const MOST_BYTES: usize = (4 << 20) + 3 * (1 << 20) + OVERHEAD_BYTES;

fn read_all_ways(bytes: &[u8]) {
    let _ = sniff(bytes);
    let _ = nifti::read_volume(bytes, &LIMITS);
    let _ = nifti::read_mask(bytes, &LIMITS);
}

/// A sound file of any type, version and byte order.
fn sound_file() -> impl Strategy<Value = Nifti> {
    let type_index = 0..DATA_TYPES.len();
    (type_index, 1u8..=2, any::<bool>(), any::<bool>()).prop_map(
        |(index, version, big_endian, by_qform)| {
            let values: Vec<f64> = (0..24).map(|i| f64::from(i * 5)).collect();
            let mut file = Nifti::of(DATA_TYPES[index], &values, version, big_endian);
            if by_qform {
                (file.qform_code, file.sform_code) = (1, 0);
            }
            file
        },
    )
}

/// Places and their new bytes; most places are in the header.
fn mutations() -> impl Strategy<Value = Vec<(usize, u8)>> {
    let place = prop_oneof![0usize..132, 0usize..560, 0usize..4096];
    let byte = prop_oneof![any::<u8>(), Just(0), Just(0xff), Just(0x7f), Just(0x80)];
    vec((place, byte), 1..12)
}

fn mutate(bytes: &mut [u8], mutations: &[(usize, u8)]) {
    let length = bytes.len();
    for &(place, byte) in mutations {
        bytes[place % length] = byte;
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    #[test]
    fn a_mutated_file_never_panics_nor_exceeds_the_limits(file in sound_file(), mutations in mutations()) {
        let mut bytes = file.bytes();
        mutate(&mut bytes, &mutations);
        let peak = peak_bytes(|| read_all_ways(&bytes));
        prop_assert!(peak <= MOST_BYTES, "{peak} bytes");
        let packed = pack(&bytes);
        let peak = peak_bytes(|| read_all_ways(&packed));
        prop_assert!(peak <= MOST_BYTES, "{peak} bytes packed");
    }

    #[test]
    fn a_mutated_stream_never_panics_nor_exceeds_the_limits(file in sound_file(), mutations in mutations()) {
        let mut packed = file.packed();
        mutate(&mut packed[2..], &mutations);
        let peak = peak_bytes(|| read_all_ways(&packed));
        prop_assert!(peak <= MOST_BYTES, "{peak} bytes");
    }

    #[test]
    fn any_bytes_never_panic(start in 0usize..5, bytes in vec(any::<u8>(), 0..1200)) {
        let starts: [&[u8]; 5] = [b"", b"\x1f\x8b\x08\0", b"\x5c\x01\0\0", b"\0\0\x02\x1c", b"\x1c\x02\0\0n+2\0\r\n\x1a\n"];
        let bytes = [starts[start], &bytes].concat();
        let peak = peak_bytes(|| read_all_ways(&bytes));
        prop_assert!(peak <= MOST_BYTES, "{peak} bytes");
    }
}

/// A file of `sides`³ zeros of a type.
fn zeros(datatype: i16, side: usize) -> Nifti {
    let mut file = Nifti::of(datatype, &vec![0.0; side.pow(3)], 1, false);
    file.dim[1..4].fill(side as i64);
    file
}

#[test]
fn a_sound_file_at_the_limit_stays_within_it() {
    for (datatype, side) in [(U8, 101), (I16, 101), (F32, 101), (F64, 80), (I64, 80)] {
        let file = zeros(datatype, side);
        for bytes in [file.bytes(), file.packed()] {
            let peak = peak_bytes(|| {
                nifti::read_volume(&bytes, &LIMITS).expect("a file within the limits");
            });
            assert!(peak <= MOST_BYTES, "{peak} bytes for type {datatype}");
            assert!(
                peak >= 2 * side.pow(3),
                "the voxels alone take more than {peak}"
            );
        }
    }
}

#[test]
fn what_is_refused_for_its_size_costs_nothing() {
    for datatype in DATA_TYPES {
        let file = zeros(datatype, 128);
        let lying = Nifti {
            data: vec![0; 24],
            dim: [3, 100, 100, 100, 1, 1, 1, 1],
            ..file.clone()
        };
        for bytes in [file.bytes(), file.packed(), lying.bytes(), lying.packed()] {
            let peak = peak_bytes(|| {
                nifti::read_volume(&bytes, &LIMITS).expect_err("a file beyond the limits");
            });
            assert!(peak <= OVERHEAD_BYTES, "{peak} bytes for type {datatype}");
        }
    }
}

#[test]
fn a_stream_that_ends_early_is_given_no_more_than_what_came() {
    let mut file = zeros(U8, 100);
    file.data.truncate(400_000);
    let packed = [pack(&file.bytes()), vec![0x1f; 4096]].concat();
    let peak = peak_bytes(|| {
        nifti::read_volume(&packed, &LIMITS).expect_err("a stream cut short");
    });
    assert!(peak <= 4 * 400_000 + OVERHEAD_BYTES, "{peak} bytes");
}
