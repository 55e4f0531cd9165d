//! Rates masks, in numbers and sentences.

use std::ops::RangeInclusive;

use geometry::{BrainCuts, BrainMask, DistanceMap, Face, Grid, Mask, Volume, as_position};
use glam::{DAffine3, DVec3};

use crate::flatness::flatness;
use crate::rating::{Rating, Reason, graded, reason, review_if};
use crate::rim::{Rim, brightness_of_rim, rim, without_scalp};
use crate::slices::{Slices, lateral_axis, slices};
use crate::supplied::{Comparison, reasons_of_border};
use crate::{ExtractionError, Prediction};

/// The measurements of a mask and its rating.
///
/// A number that could not be measured, or that does not apply to the origin of the mask, is `None`.
#[derive(Debug, Clone, PartialEq)]
pub struct Quality {
    /// The worst rating on any number.
    pub rating: Rating,
    /// A reason for each unusual number; empty if the rating is [`Rating::Ok`].
    pub reasons: Vec<Reason>,
    /// Volume of the mask, in millilitres: ok from 900 to 2200, failed outside of 700 to 2500.
    pub volume_ml: f64,
    /// Fraction of the marked voxels in the largest component, 0 to 1: ok from 0.98.
    pub largest_component: f64,
    /// The area of the mask on each face of the field of view, in cm², in the order of [`Face::ALL`]: ok up to 1, on the
    /// inferior face below 15.
    pub cut_area_cm2: [f64; 6],
    /// The shape of a mask that this crate found. A supplied mask may follow the sulci, and is compared with the brain that the
    /// network finds instead.
    pub shape: Option<Shape>,
    /// How much brighter the inside of the brain is than its rim, as a fraction of the intensity range: ok from 0.05;
    /// with tree pruning, from 0.1.
    pub contrast: Option<f64>,
    /// The agreement (Dice) of the coarse pass of the network with the mask: ok from 0.97, failed below 0.90.
    pub agreement: Option<f64>,
    /// Voxels of which the network is uncertain (0.05 < p < 0.95), as a fraction of the voxels of the brain: ok up to
    /// 0.035, failed from 0.1.
    pub uncertain: Option<f64>,
    /// How well the border of a supplied mask fits the volume.
    pub rim: Option<Rim>,
    /// How a supplied mask compares with the brain that the network finds.
    pub comparison: Option<Comparison>,
    /// The slices of the volume within the brain, along each of its axes.
    pub slices: [Option<Slices>; 3],
    /// An alternative affine from voxels to LPS mm, with which the network finds a brain although it does not with the
    /// affine in the header: the header may be wrong. A person must confirm this; nothing is turned.
    pub other_patient_from_voxel: Option<DAffine3>,
}

/// The shape of a mask.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Size of the mask from left to right, front to back and bottom to top, in mm.
    pub extents_mm: [f64; 3],
    /// The volume that a closing by 10 mm adds, as a fraction of the mask: ok up to 0.05.
    pub closing_added: f64,
    /// The overlap (Dice) of the mask with its mirror image from left to right, front to back and bottom to top: ok if
    /// the first is the greatest.
    pub symmetry: [f64; 3],
    /// The position of the centre between front (0) and back (1): ok from 0.5, because brains are wider at the back.
    pub centre_from_front: f64,
    /// The standard deviation of the mask along its shortest principal axis, as a fraction of that along its longest one: ok from
    /// 0.62.
    pub flatness: f64,
}

/// The greatest area that a mask may cover on a face, in cm².
const MOST_ON_A_FACE_CM2: f64 = 1.0;

/// The same for the inferior face, in cm²: the brain stem and the cord cover at most 10 cm² of it.
const MOST_BELOW_CM2: f64 = 15.0;

/// The least height of a brain, as a fraction of its length.
const LEAST_HEIGHT: f64 = 0.65;

/// The least [`flatness`] of a brain. Of eight sound heads, from 0.67 to 0.79; with 0.75 times their slice distance, 0.52 to 0.60.
const LEAST_FLATNESS: f64 = 0.62;

fn reason_of_face(face: Face, area_cm2: f64) -> Option<Reason> {
    let is_cut = match face {
        Face::Inferior => area_cm2 >= MOST_BELOW_CM2,
        _ => area_cm2 > MOST_ON_A_FACE_CM2,
    };
    reason(review_if(is_cut), code_of_cut(face), || {
        format!(
            "the mask covers {area_cm2:.0} cm² of the {} face of the volume, or of a plane beyond which the volume is constant; is the \
             brain cut there?",
            face.name()
        )
    })
}

fn code_of_cut(face: Face) -> &'static str {
    match face {
        Face::Left => "mask-cut-left",
        Face::Right => "mask-cut-right",
        Face::Posterior => "mask-cut-posterior",
        Face::Anterior => "mask-cut-anterior",
        Face::Superior => "mask-cut-superior",
        Face::Inferior => "mask-cut-inferior",
    }
}

/// Why tree pruning was used.
#[derive(Debug, Clone, Copy)]
pub enum Because {
    Asked,
    /// There is no network.
    NoNetwork,
    /// The network found no mask that can be trusted.
    NetworkFailed,
}

impl Because {
    fn words(self) -> &'static str {
        match self {
            Self::Asked => "",
            Self::NoNetwork => " because the network's weights are missing",
            Self::NetworkFailed => " because the network found no mask that can be trusted",
        }
    }
}

/// How far the axes of a header may be from right angles, as for the slices of a DICOM series.
const MOST_LEAN_DEGREES: f64 = 0.5;

/// The sides on which a head has scalp: faces are removed in front, and below is the neck.
const SCALP_SIDES: [Face; 4] = [Face::Left, Face::Right, Face::Posterior, Face::Superior];

/// The share of a side beyond which there may be nothing but air, and the same of each other side. Three sound heads have 0 on
/// each side; with the uppermost 20 mm faded out, five heads have 0.49 to 0.66 above, and with noise there 0.86 to 0.94.
const MOST_BARE: f64 = 0.2;
const MOST_BARE_ELSEWHERE: f64 = 0.1;

/// The fewest different values of a volume that shows two tissues: 8 bits give 100 and more, label maps and masks a few dozen.
const LEAST_VALUES: usize = 64;

/// The most of the brightness of the inside that the rim of a skull-stripped brain has. Five right ones have 0.39 to 0.59, with 4 mm taken
/// off all around 0.63 to 0.87. In inverted volumes, the rim is brighter than the inside.
const MOST_OF_RIM: f64 = 0.62;

/// The limits of [`Slices`]: of its order, by how much it exceeds those along the other axes, and of its step.
const MOST_ORDER: f64 = 0.88;
const MORE_THAN_OTHERS: f64 = 1.15;
const MOST_STEP: f64 = 2.2;

/// The greatest distance of slices whose steps are rated, in mm: a smooth pattern in voxels of 4 mm has a step of 3.
const COARSEST_STEP_MM: f64 = 2.05;

/// The names of the axes of a file.
const AXES: [&str; 3] = ["first", "second", "third"];

/// The rim of the brain ends at this depth, and its inside begins at that one, in mm.
const RIM_MM: f32 = 8.0;
const INSIDE_MM: f32 = 18.0;

/// A mask in all its forms, with the volume to which it belongs.
#[derive(Debug, Clone, Copy)]
pub struct Masked<'a> {
    /// The mask as it was found or supplied, on its own grid.
    pub mask: &'a Mask,
    /// The mask on the working grid.
    pub brain: &'a BrainMask,
    /// The depth below its envelope, from [`closed`](crate::closed()).
    pub closed: &'a DistanceMap,
    pub cuts: &'a BrainCuts,
    pub volume: &'a Volume,
}

/// Where a mask comes from, with what is known about it beside the volume. It decides what is measured.
#[derive(Debug, Clone, Copy)]
pub enum Origin<'a> {
    /// The network predicted it.
    Predicted(&'a Prediction),
    /// The network predicted it with other axes than those of the volume, and it passed as such: its agreement and uncertainty.
    Turned([Option<f64>; 2]),
    /// Tree pruning found it.
    Pruned(Because),
    Supplied(Opinion<'a>),
    /// The volume is skull-stripped, and it is what is not 0.
    Stripped(Opinion<'a>),
}

/// What the network says of a volume whose mask it did not make.
#[derive(Debug, Clone, Copy)]
pub enum Opinion<'a> {
    /// There is no network.
    NotAsked,
    /// It finds no brain.
    NoBrain,
    /// It is not certain of the brain that it finds.
    Uncertain,
    /// The depth below the envelope of the brain that it finds.
    Brain(&'a DistanceMap),
}

/// Rates a mask: the one place that decides what is unusual about it.
///
/// A mask that came with the upload is at worst [`Rating::Review`], because somebody chose it.
///
/// # Errors
/// If the mask cannot be compared on its grid.
pub fn rate(masked: Masked<'_>, origin: Origin<'_>) -> Result<Quality, ExtractionError> {
    let mut quality = Quality::measure(masked);
    quality.rate_volume();
    quality.rate_pieces();
    quality.rate_cuts();
    quality.rate_slices(masked);
    if !matches!(origin, Origin::Stripped(_)) {
        quality.rate_scalp(masked);
    }
    match origin {
        Origin::Predicted(prediction) => {
            quality.rate_as_found(masked);
            quality.agreement = Some(agreement(prediction, masked.brain)?);
            quality.uncertain = Some(uncertain_share(prediction));
            quality.rate_prediction();
        }
        Origin::Turned([agreement, uncertain]) => {
            quality.rate_as_found(masked);
            (quality.agreement, quality.uncertain) = (agreement, uncertain);
        }
        Origin::Pruned(because) => {
            quality.rate_as_found(masked);
            quality.rate_pruning(because);
        }
        Origin::Supplied(network) => {
            quality.rate_as_supplied(masked, network)?;
            quality.rating = quality.rating.min(Rating::Review);
        }
        Origin::Stripped(network) => {
            quality.rate_as_stripped(masked, network)?;
            quality.rating = quality.rating.min(Rating::Review);
        }
    }
    Ok(quality)
}

impl Quality {
    /// The measurements of every mask; nothing is rated yet.
    fn measure(masked: Masked<'_>) -> Self {
        Self {
            rating: Rating::Ok,
            reasons: Vec::new(),
            volume_ml: masked.brain.volume_ml(),
            largest_component: masked.mask.largest_component_share(),
            cut_area_cm2: masked.cuts.area_cm2,
            shape: None,
            contrast: None,
            agreement: None,
            uncertain: None,
            rim: None,
            comparison: None,
            slices: [None; 3],
            other_patient_from_voxel: None,
        }
    }

    /// Whether a side of the brain ends in air while the others lie below scalp: the head fades out there, or its slices are noise.
    fn rate_scalp(&mut self, masked: Masked<'_>) {
        let bare = without_scalp(masked.volume, masked.closed).unwrap_or_default();
        let share = |face: Face| bare[face as usize];
        for face in SCALP_SIDES {
            let others = SCALP_SIDES.into_iter().filter(|&other| other != face);
            let is_alone = others.map(share).fold(0.0, f64::max) < MOST_BARE_ELSEWHERE;
            let is_bare = share(face) > MOST_BARE;
            self.say(review_if(is_alone && is_bare), "scalp-missing", || {
                format!(
                    "beyond {:.0} % of the {} side of the brain there is nothing but air, and scalp on the other sides; does the brain \
                     fade out or end in noise there?",
                    100.0 * share(face),
                    face.name()
                )
            });
        }
    }

    /// Whether the headers and the stored values describe a head: whether the axes are perpendicular, how many voxels inside the
    /// envelope were no finite numbers, and whether a header states no axes, so that some were assumed.
    pub fn rate_source(&mut self, volume_grid: &Grid, not_finite: usize, are_axes_assumed: bool) {
        let axes = volume_grid.patient_from_voxel().matrix3;
        let unit = [0, 1, 2].map(|axis| axes.col(axis).normalize());
        let cosine = |a: usize, b: usize| unit[a].dot(unit[b]).abs();
        let most = cosine(0, 1).max(cosine(0, 2)).max(cosine(1, 2)).min(1.0);
        let lean = most.asin().to_degrees();
        self.say(review_if(lean > MOST_LEAN_DEGREES), "axes-sheared", || {
            format!(
                "the axes of the header lean by {lean:.1}° from right angles; lengths and depths are true only if the head was scanned so, \
                 and wrong if it was registered to a template"
            )
        });
        self.say(review_if(are_axes_assumed), "axes-assumed", || {
            "an MGH file does not state its axes (its goodRASflag is 0), so FreeSurfer's default was used: they point left, down and forwards, \
             and voxels have 1 mm; ask whoever made the file which side is left"
                .to_owned()
        });
        self.say(review_if(not_finite > 0), "voxels-not-finite", || {
            format!(
                "{not_finite} voxels inside the brain are not finite numbers and are shown as 0; export the volume again, or set them to the \
                 values that belong there"
            )
        });
    }

    /// By shape and contrast, which every mask of this crate has.
    fn rate_as_found(&mut self, masked: Masked<'_>) {
        let shape = Shape::of(masked);
        self.rate_shape(shape);
        self.shape = Some(shape);
        self.contrast = contrast(masked.volume, masked.closed);
        self.rate_contrast(LEAST_CONTRAST);
    }

    /// By the brain that the network finds; without one, by the border alone.
    fn rate_as_supplied(
        &mut self,
        masked: Masked<'_>,
        network: Opinion<'_>,
    ) -> Result<(), ExtractionError> {
        let Masked {
            mask,
            closed,
            volume,
            ..
        } = masked;
        self.contrast = contrast(volume, closed);
        self.rate_contrast(LEAST_CONTRAST_OF_OTHERS);
        self.rim = rim(volume, closed);
        self.compare(masked, network)?;
        self.rate_opinion(network);
        let reasons: Vec<Reason> = match &self.comparison {
            Some(comparison) => comparison.reasons().collect(),
            None => reasons_of_border(self.rim, mask.grid(), volume.grid()).collect(),
        };
        for reason in reasons {
            self.add(reason);
        }
        Ok(())
    }

    /// A brain over zeros may be anything over zeros: it is one if it looks like a brain, to the network too.
    fn rate_as_stripped(
        &mut self,
        masked: Masked<'_>,
        network: Opinion<'_>,
    ) -> Result<(), ExtractionError> {
        let values = distinct_values(masked);
        self.say(review_if(values < LEAST_VALUES), "volume-few-values", || {
            format!(
                "the volume has only {values} different values where it is not 0; is it a mask or a label map, or was it stored with too few \
                 grey levels?"
            )
        });
        self.contrast = contrast(masked.volume, masked.closed);
        // Of a single value there is nothing more to say.
        if values >= LEAST_VALUES {
            self.rate_contrast(LEAST_CONTRAST_OF_OTHERS);
            let rim = brightness_of_rim(masked.volume, masked.closed).unwrap_or_default();
            self.say(review_if((MOST_OF_RIM..1.0).contains(&rim)), "mask-tight", || {
                "the brain begins with bright tissue, not with fluid; was more taken off than the skull? Depths count from where the zeros end, \
                 not from the dura"
                    .to_owned()
            });
        }
        self.compare(masked, network)?;
        self.rate_opinion(network);
        // How far apart the borders are says nothing: without dura around it, the network's brain is less exact than the zeros are.
        let overlap = self.comparison.and_then(|found| {
            found.reason_of_overlap(
                "what is not 0 in the volume",
                "is there more than the brain? Send a mask, or have the network find the brain (`source=network`)",
            )
        });
        if let Some(reason) = overlap {
            self.add(reason);
        }
        Ok(())
    }

    fn compare(&mut self, masked: Masked<'_>, network: Opinion<'_>) -> Result<(), ExtractionError> {
        if let Opinion::Brain(network) = network {
            self.comparison = Comparison::new(masked.closed, network, masked.volume.grid())?;
        }
        Ok(())
    }

    fn rate_opinion(&mut self, network: Opinion<'_>) {
        let finds_none = matches!(network, Opinion::NoBrain);
        self.say(review_if(finds_none), "network-no-brain", || {
            "the network finds no brain in this volume, so that the mask was compared with nothing; is it a T1-weighted head?"
                .to_owned()
        });
        let is_uncertain = matches!(network, Opinion::Uncertain);
        self.say(review_if(is_uncertain), "network-uncertain", || {
            "the network is not certain that there is a brain in this volume, so that the mask was compared with nothing; is it a T1-weighted \
             head?"
                .to_owned()
        });
    }

    /// Whether the slices follow one another as those of one head.
    fn rate_slices(&mut self, masked: Masked<'_>) {
        let grid = masked.volume.grid();
        self.slices = slices(masked.volume, masked.closed);
        let orders = self
            .slices
            .map(|slices| slices.map_or(0.0, |slices| slices.order));
        for (axis, slices) in self.slices.into_iter().enumerate() {
            let Some(Slices {
                order,
                step,
                step_at,
            }) = slices
            else {
                continue;
            };
            let others = (0..3)
                .filter(|&other| other != axis)
                .map(|other| orders[other]);
            // Noise makes all axes alike.
            let is_mixed =
                order > MOST_ORDER && order > MORE_THAN_OTHERS * others.fold(0.0, f64::max);
            // From left to right, the fissure is a step in every head; of coarse slices, too few lie around one to compare it with.
            let is_fine = grid.spacing_mm()[axis] <= COARSEST_STEP_MM;
            let is_moved = step > MOST_STEP && is_fine && axis != lateral_axis(grid);
            let name = AXES[axis];
            self.say(review_if(is_mixed), "slices-order", || {
                format!(
                    "along its {name} axis, neighbouring slices differ {order:.2} times as much as slices two apart (sound heads: 0.5 to 0.7): are \
                     slices exchanged or mirrored, or large parts fluid or noise, or single voxels very bright? Compare the original images"
                )
            });
            self.say(review_if(is_moved && !is_mixed), "slices-step", || {
                format!(
                    "along its {name} axis, two neighbouring slices, at {:.0} % of the brain, differ {step:.1} times as much as those around them: \
                     was a part mirrored or moved, or is it fluid or very bright? Compare the original images",
                    100.0 * step_at
                )
            });
        }
    }

    fn rate_volume(&mut self) {
        let volume_ml = self.volume_ml;
        let lies_in = |least, most| (least..=most).contains(&volume_ml);
        let rating = graded(!lies_in(900.0, 2200.0), !lies_in(700.0, 2500.0));
        self.say(rating, "mask-volume", || {
            format!("the mask has {volume_ml:.0} ml; a brain has 900 to 2200 ml")
        });
    }

    fn rate_pieces(&mut self) {
        let lost = 100.0 * (1.0 - self.largest_component);
        let rating = review_if(self.largest_component < 0.98);
        self.say(rating, "mask-pieces", || {
            format!("{lost:.1} % of the mask lay outside its largest component and was dropped")
        });
    }

    fn rate_cuts(&mut self) {
        for (face, area_cm2) in Face::ALL.into_iter().zip(self.cut_area_cm2) {
            if let Some(reason) = reason_of_face(face, area_cm2) {
                self.add(reason);
            }
        }
    }

    fn rate_shape(&mut self, shape: Shape) {
        let Shape {
            extents_mm: [width, length, height],
            closing_added: added,
            symmetry: [across, along, upwards],
            centre_from_front,
            flatness,
        } = shape;
        self.say(review_if(added > 0.05), "mask-ragged", || {
            format!(
                "closing the mask by 10 mm adds {:.1} % to it; a mask up to the dura gains less than 5 %",
                added * 100.0
            )
        });
        let usual = [
            (100.0..=175.0, width),
            (130.0..=215.0, length),
            (85.0..=185.0, height),
        ];
        let is_unusual = usual.iter().any(|(range, extent)| !range.contains(extent));
        self.say(review_if(is_unusual), "mask-extents", || {
            format!("the mask is {width:.0} mm wide, {length:.0} mm long and {height:.0} mm high, which is unusual for a brain")
        });
        let is_low = height < LEAST_HEIGHT * length;
        self.say(review_if(is_low || flatness < LEAST_FLATNESS), "mask-flat", || {
            let found = match is_low {
                true => format!("the mask is {height:.0} mm high and {length:.0} mm long, but a brain is at least 0.65 times as high as long"),
                false => format!(
                    "along its shortest axis the mask extends {flatness:.2} times as far as along its longest one, but a brain at least 0.62 \
                     times"
                ),
            };
            format!("{found}; is the slice distance correct, and is the brain complete?")
        });
        self.say(review_if(length < width || length < height), "axes-length", || {
            format!(
                "the mask is {length:.0} mm long, less than its width ({width:.0} mm) or its height ({height:.0} mm); are the axes in the \
                 header correct?"
            )
        });
        self.say(review_if(across < along || across < upwards), "axes-symmetry", || {
            "the mask is more symmetric along another axis than from left to right; are the axes in the header correct?"
                .to_owned()
        });
        self.say(review_if(centre_from_front < 0.5), "axes-front", || {
            "the mask is wider at the front than at the back; are the axes in the header correct?"
                .to_owned()
        });
    }

    fn rate_contrast(&mut self, least: f64) {
        if let Some(reason) = reason_of_contrast(self.contrast, least) {
            self.add(reason);
        }
    }

    fn rate_prediction(&mut self) {
        if let Some(agreement) = self.agreement {
            let rating = graded(agreement < 0.97, agreement < 0.90);
            self.say(rating, "network-agreement", || {
                format!(
                    "the coarse and the fine pass of the network agree by {agreement:.3} (Dice); sound heads reach 0.97"
                )
            });
        }
        if let Some(uncertain) = self.uncertain {
            let rating = graded(uncertain > 0.035, uncertain > 0.1);
            self.say(rating, "network-uncertain", || {
                format!(
                    "the network is uncertain of {:.1} % of the voxels; in sound heads, of 2 %",
                    uncertain * 100.0
                )
            });
        }
    }

    /// A mask found without the network is never ok, because tree pruning does not measure its certainty.
    fn rate_pruning(&mut self, because: Because) {
        self.say(Rating::Review, "tree-pruning", || {
            format!(
                "the brain was found by tree pruning{}; this method does not measure its certainty",
                because.words()
            )
        });
        let contrast = self.contrast.unwrap_or_default();
        let is_low = (LEAST_CONTRAST..LEAST_CONTRAST_OF_PRUNING).contains(&contrast);
        self.say(review_if(is_low), "contrast-low", || {
            format!(
                "the inside of the brain is brighter than its rim by only {contrast:.3} of the intensity range; in sound heads, by 0.147. \
                 Tree pruning may be wrong by a quarter of the brain"
            )
        });
    }

    fn say(&mut self, rating: Rating, code: &'static str, sentence: impl FnOnce() -> String) {
        if let Some(reason) = reason(rating, code, sentence) {
            self.add(reason);
        }
    }

    fn add(&mut self, reason: Reason) {
        self.rating = self.rating.max(reason.rating);
        self.reasons.push(reason);
    }

    /// Whether the network is certain enough for its mask to be compared with a supplied one.
    pub(crate) fn is_certain(&self) -> bool {
        let lies_in = |value: Option<f64>, range: RangeInclusive<f64>| {
            value.is_some_and(|value| range.contains(&value))
        };
        lies_in(self.agreement, 0.95..=1.0) && lies_in(self.uncertain, 0.0..=0.05)
    }

    /// Whether the shape of the mask contradicts the axes of the volume.
    pub(crate) fn doubts_axes(&self) -> bool {
        self.reasons
            .iter()
            .any(|reason| reason.code.starts_with("axes-"))
    }

    /// Adds that the network finds the brain with other axes, and their affine.
    pub(crate) fn offer_axes(&mut self, patient_from_voxel: DAffine3) {
        self.other_patient_from_voxel = Some(patient_from_voxel);
        self.say(Rating::Review, "axes-other", || {
            "the network finds the brain only with other axes than those in the header; check the letters on the picture. The picture cannot \
             tell left from right: if the header reverses one axis or exchanges two, `corrected_header.mirrored` is correct, and \
             `corrected_header.turned` exchanges left and right. Ask whoever made the file which side is left, then upload the volume with \
             that header; its rows are LPS, and those of a NIfTI header have the opposite sign in the first two"
                .to_owned()
        });
    }
}

/// The least contrast between inside and rim of a T1-weighted brain, and the least for which tree pruning is reliable.
const LEAST_CONTRAST: f64 = 0.05;
const LEAST_CONTRAST_OF_PRUNING: f64 = 0.1;

/// The same of a supplied mask, and of a skull-stripped volume, whose rim may lack the fluid: T2 and FLAIR, in which the cortex is
/// brighter, and inverted volumes have less.
const LEAST_CONTRAST_OF_OTHERS: f64 = 0.0;

/// The reason that follows from the contrast between inside and rim.
fn reason_of_contrast(contrast: Option<f64>, least: f64) -> Option<Reason> {
    match contrast {
        None => reason(Rating::Review, "mask-thin", || {
            "the mask is too thin to have an inside".to_owned()
        }),
        Some(contrast) => reason(review_if(contrast <= least), "contrast-inverted", || {
            "the inside of the brain is not brighter than its rim; is this a T1-weighted volume?"
                .to_owned()
        }),
    }
}

/// How many different values a volume has in a mask on its own grid, as that of a skull-stripped volume is.
fn distinct_values(Masked { mask, volume, .. }: Masked<'_>) -> usize {
    let mut occurs = vec![false; 1 << 16];
    let voxels = volume.voxels().iter().zip(mask.voxels());
    for (&stored, _) in voxels.filter(|(_, is_brain)| **is_brain) {
        occurs[usize::from(stored)] = true;
    }
    occurs.into_iter().filter(|&occurs| occurs).count()
}

impl Shape {
    fn of(Masked { brain, closed, .. }: Masked<'_>) -> Self {
        let mask = brain.mask();
        let [first, last] = mask.bounds().unwrap_or_default();
        let centre = centre(mask);
        Self {
            extents_mm: brain.extents_mm(),
            closing_added: closed.envelope().volume_ml() / brain.volume_ml() - 1.0,
            symmetry: symmetry(mask, centre),
            centre_from_front: (centre.y + 0.5 - first[1] as f64) / (last[1] + 1 - first[1]) as f64,
            flatness: flatness(mask, centre),
        }
    }
}

/// The centroid of a set, in voxels.
fn centre(mask: &Mask) -> DVec3 {
    let [nx, ny, _] = mask.grid().size();
    let (mut sum, mut count) = ([0usize; 3], 0usize);
    for (row, voxels) in mask.voxels().chunks_exact(nx).enumerate() {
        let marked = (0..nx).filter(|&x| voxels[x]);
        let (places, number) = marked.fold((0, 0), |(places, number), x| (places + x, number + 1));
        count += number;
        sum = [
            sum[0] + places,
            sum[1] + number * (row % ny),
            sum[2] + number * (row / ny),
        ];
    }
    DVec3::from_array(sum.map(|sum| sum as f64)) / count.max(1) as f64
}

/// The Dice coefficients of a set with its mirror images at the planes through its centre, which is rounded to half a
/// voxel.
fn symmetry(mask: &Mask, centre: DVec3) -> [f64; 3] {
    let grid = mask.grid();
    let size = grid.size();
    let twice = (centre * 2.0)
        .round()
        .to_array()
        .map(|place| place as usize);
    let (mut marked, mut mirrored) = (0usize, [0usize; 3]);
    for (row, voxels) in mask.voxels().chunks_exact(size[0]).enumerate() {
        let [y, z] = [row % size[1], row / size[1]];
        for x in (0..size[0]).filter(|&x| voxels[x]) {
            marked += 1;
            for axis in 0..3 {
                let mut voxel = [x, y, z];
                voxel[axis] = twice[axis].wrapping_sub(voxel[axis]);
                let is_marked = voxel[axis] < size[axis] && mask.voxels()[grid.index(voxel)];
                mirrored[axis] += usize::from(is_marked);
            }
        }
    }
    mirrored.map(|mirrored| mirrored as f64 / marked.max(1) as f64)
}

/// How much brighter the inside of the brain is than its rim: the difference of medians, as a fraction of the range
/// from the 5th to the 95th percentile of both; 0 if all are alike. `None` if there is no inside.
fn contrast(volume: &Volume, distance: &DistanceMap) -> Option<f64> {
    let grid = distance.grid();
    let native_from_working = volume.grid().voxel_from_patient() * grid.patient_from_voxel();
    let (mut rim, mut inside) = (Vec::new(), Vec::new());
    for index in 0..grid.voxel_count() {
        let Some(depth_mm) = distance.depth_mm(index) else {
            continue;
        };
        if !distance.is_known(index) {
            continue;
        }
        let position = native_from_working.transform_point3(as_position(grid.voxel(index)));
        let Some(native) = volume.grid().nearest(position) else {
            continue;
        };
        let intensity = volume.intensity(f32::from(volume.voxels()[native]));
        if depth_mm <= RIM_MM {
            rim.push(intensity);
        } else if depth_mm >= INSIDE_MM {
            inside.push(intensity);
        }
    }
    let difference = quantile(&mut inside, 0.5)? - quantile(&mut rim, 0.5)?;
    rim.append(&mut inside);
    let range = quantile(&mut rim, 0.95)? - quantile(&mut rim, 0.05)?;
    Some(match range > 0.0 {
        true => f64::from(difference / range),
        false => 0.0,
    })
}

fn quantile(values: &mut [f32], fraction: f64) -> Option<f32> {
    let rank = (fraction * values.len().checked_sub(1)? as f64).round() as usize;
    Some(*values.select_nth_unstable_by(rank, f32::total_cmp).1)
}

/// The Dice coefficient of the largest component of the coarse pass with the mask.
fn agreement(prediction: &Prediction, brain: &BrainMask) -> Result<f64, ExtractionError> {
    let mask = brain.mask();
    let coarse_ml = prediction
        .coarse
        .above(0.5)?
        .largest_component()
        .volume_ml();
    let coarse = prediction
        .coarse
        .above_on(mask.grid(), 0.5)?
        .largest_component();
    let pairs = mask.voxels().iter().zip(coarse.voxels());
    let both = pairs.map(|(&a, &b)| a && b).collect();
    let both_ml = Mask::new(mask.grid().clone(), both)?.volume_ml();
    Ok(2.0 * both_ml / (mask.volume_ml() + coarse_ml))
}

fn uncertain_share(prediction: &Prediction) -> f64 {
    let values = prediction.fine.values();
    let is_uncertain = |&&value: &&f32| 0.05 < value && value < 0.95;
    let uncertain = values.iter().filter(is_uncertain).count();
    let brain = values.iter().filter(|&&value| value > 0.5).count();
    uncertain as f64 / brain.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rating of a usual brain, whose stem leaves the volume.
    fn usual() -> Quality {
        Quality {
            rating: Rating::Ok,
            reasons: Vec::new(),
            volume_ml: 1300.0,
            largest_component: 1.0,
            cut_area_cm2: [0.0, 0.0, 0.0, 0.0, 0.0, 9.0],
            shape: None,
            contrast: None,
            agreement: None,
            uncertain: None,
            rim: None,
            comparison: None,
            slices: [None; 3],
            other_patient_from_voxel: None,
        }
    }

    fn codes(mut quality: Quality) -> Vec<&'static str> {
        quality.rate_volume();
        quality.rate_pieces();
        quality.rate_cuts();
        let codes: Vec<_> = quality.reasons.iter().map(|reason| reason.code).collect();
        assert_eq!(quality.rating == Rating::Ok, codes.is_empty());
        codes
    }

    #[test]
    fn a_usual_brain_is_ok_even_where_its_stem_leaves_the_volume() {
        assert!(codes(usual()).is_empty());
    }

    #[test]
    fn what_is_unusual_is_put_to_review_with_its_reason() {
        let mut cut = usual();
        cut.cut_area_cm2[4] = 30.0;
        let apart = Quality {
            largest_component: 0.9,
            ..usual()
        };
        let small = Quality {
            volume_ml: 420.0,
            ..apart.clone()
        };
        assert_eq!(codes(cut), ["mask-cut-superior"]);
        assert_eq!(codes(apart), ["mask-pieces"]);
        assert_eq!(codes(small), ["mask-volume", "mask-pieces"]);
    }

    #[test]
    fn a_brain_that_is_cut_off_below_is_told_from_one_whose_stem_leaves_the_volume() {
        for (area_cm2, expected) in [(14.9, vec![]), (15.0, vec!["mask-cut-inferior"])] {
            let mut cut = usual();
            cut.cut_area_cm2[5] = area_cm2;
            assert_eq!(codes(cut), expected);
        }
    }

    #[test]
    fn leaning_axes_and_voxels_that_are_not_finite_are_doubted() {
        let leaning = |degrees: f64| {
            let axes = glam::DMat3::from_cols(
                DVec3::X,
                DVec3::new(degrees.to_radians().sin(), degrees.to_radians().cos(), 0.0),
                DVec3::Z,
            );
            Grid::new([4, 4, 4], DAffine3::from_mat3(axes)).expect("a grid")
        };
        let codes = |degrees: f64, not_finite: usize, are_axes_assumed: bool| {
            let mut quality = usual();
            quality.rate_source(&leaning(degrees), not_finite, are_axes_assumed);
            let codes: Vec<_> = quality.reasons.iter().map(|reason| reason.code).collect();
            codes
        };
        assert!(codes(0.4, 0, false).is_empty());
        assert_eq!(codes(0.6, 0, false), ["axes-sheared"]);
        assert_eq!(codes(0.0, 1, false), ["voxels-not-finite"]);
        assert_eq!(codes(0.0, 0, true), ["axes-assumed"]);
    }
}
