//! Near-lossless JPEG-LS against another implementation.
//!
//! CharLS (through pyjpegls 1.5) encoded the images of [`sample`]; the digests are of the images that CharLS decodes
//! from them.

use super::decode;

struct Picture {
    size: [usize; 2],
    most: u32,
    near: u32,
    packed: &'static str,
    digest: u32,
}

const EIGHT_BITS: Picture = Picture {
    size: [24, 10],
    most: 255,
    near: 3,
    packed: "\
        ffd8fff7000b08000a001801011100ffda0008010100030000000ef000000631430ca725f6db6db2f5488beafdba040408204187ff7c0e04\
        08c60c06bffc1a652998057ff43194000204800180006000600030000c000c880030001930003a0d00ca4200400063413ca48e854440ac9a\
        0e90ae3a42b84a65d533aee2c9cfb1293257430056f62b9ec6ffd9",
    digest: 878_372_854,
};

const TWELVE_BITS: Picture = Picture {
    size: [20, 9],
    most: 4095,
    near: 7,
    packed: "\
        ffd8fff7000b0c0009001401011100ffda00080101000700000000000002b49580000000014bf5f59800023cf7cf3cf7ccf6e9ad2579de8c\
        8897f70ac8c8d3fb07444640000000002e60000000002e90000000002e91a9d4e874000000000173d1d91190000000000b40000000000c09\
        a242b448368800000000182d0ec88c80000000005a2cf20da241b3c8314a8b446440000000002cecd120d9e40b3c2251a888dc000000000b\
        98000000000c0eb3666a6900ffd9",
    digest: 2_208_417_249,
};

const SIXTEEN_BITS: Picture = Picture {
    size: [16, 6],
    most: 65535,
    near: 1,
    packed: "\
        ffd8fff7000b100006001001011100fff8000d01ffff00150048011b0040ffda000801010001000000000005c70040202020000000000000\
        2e13e178bc0cc1782e007bc554aa9d553007b03c11088686822008020100762b0b452525216802020201c51cb4b54a9180da8000000018a1\
        2890000000018962ce188c4c4b43029780452f000560cb4a56a9186958134ac004ffd9",
    digest: 446_485_438,
};

/// An image with flat stretches, which are coded as runs, a slope, and noise.
fn sample(picture: &Picture, [x, y]: [u32; 2]) -> u32 {
    let ([columns, rows], most) = (picture.size.map(|side| side as u32), picture.most);
    let hash = (u64::from(x) * 2_654_435_761 + u64::from(y) * 40503) >> 4;
    match x {
        0..6 => most / 3,
        6..12 => (x * 37 + y * y * 11) % (most + 1),
        _ if y < rows / 2 => x * most / columns,
        _ => (hash % u64::from(most + 1)) as u32,
    }
}

fn bytes(hexadecimal: &str) -> Vec<u8> {
    let pairs = hexadecimal.as_bytes().chunks(2);
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    pairs.map(byte).collect()
}

#[test]
fn near_lossless_pictures_are_those_that_another_program_unpacks() {
    for picture in [EIGHT_BITS, TWELVE_BITS, SIXTEEN_BITS] {
        let samples = decode(&bytes(picture.packed), picture.size).unwrap();
        let digest = samples.iter().fold(0u32, |digest, &sample| {
            digest.wrapping_mul(31).wrapping_add(sample.into())
        });
        let columns = picture.size[0];
        let mut furthest = 0;
        for (index, &found) in samples.iter().enumerate() {
            let place = [index % columns, index / columns].map(|along| along as u32);
            furthest = furthest.max(sample(&picture, place).abs_diff(found.into()));
        }
        // It is lossy, within the stated bound.
        assert_eq!((furthest, digest), (picture.near, picture.digest));
    }
}
