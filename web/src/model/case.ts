// A case as the server describes it.

import type { Affine, Vec3 } from "./space.ts";

/** A DICOM window (PS3.3 C.11.2.1.2, LINEAR), in intensities. */
export interface Window {
  readonly center: number;
  readonly width: number;
}

/** Least and greatest intensity, and the window that is shown first. */
export interface Intensity {
  readonly min: number;
  readonly max: number;
  readonly window: Window;
}

export interface Sphere {
  readonly center_in_patient: Vec3;
  readonly radius_mm: number;
}

/**
 * A plane in the patient: the points whose product with the normal is `offset_mm`. The normal is of length 1, to the
 * left.
 */
export interface MirrorPlane {
  readonly normal: Vec3;
  readonly offset_mm: number;
  /** The two sides differ so much that a fitted plane may be wrong. */
  readonly doubtful?: boolean;
}

/** A problem of RFC 9457. */
export interface ProblemBody {
  readonly type?: string;
  readonly title?: string;
  readonly detail?: string;
  /** The name of the reason, if it is one of several. */
  readonly reason?: string;
}

export interface Series {
  readonly number: number | null;
  /** The kind of the sequence. */
  readonly name: string;
  readonly is_volume: boolean;
  /** What names it in another upload. */
  readonly token: string;
}

interface AnyCase {
  /** 32 hexadecimal digits. */
  readonly id: string;
  readonly name: string | null;
  /** RFC 3339. */
  readonly created_at: string;
  /** Whether it is never removed because of its age. */
  readonly kept: boolean;
  /** Whether it is in the trash. */
  readonly trashed?: boolean;
  /** Why it is closed; absent if it is open. */
  readonly closed?: "corrected" | "rejected";
  /** When the server will remove it because of its age; absent if it will not. */
  readonly expires_at?: string;
  /** The case that this is a version of, with another mask or other parameters. */
  readonly previous?: string;
  /** Its own versions. */
  readonly next?: readonly string[];
  /** In the answer to an upload of DICOM: the series that were not chosen. */
  readonly dicom?: { readonly others: readonly Series[] };
}

export interface WaitingCase extends AnyCase {
  readonly state: "queued" | "preparing";
  readonly progress?: { readonly stage: string; readonly fraction: number };
}

export interface FailedCase extends AnyCase {
  readonly state: "failed";
  readonly error?: ProblemBody;
}

/** How far a mask is to be trusted. */
export interface Quality {
  readonly state: "ok" | "review" | "failed";
  /** How the mask was made: `supplied`, `volume`, `network` or `tree_pruning`. */
  readonly method: string;
  /** Its extents are those from left to right, front to back and bottom to top. */
  readonly numbers?: { readonly brain_ml: number; readonly extents_mm: readonly [number, number, number] };
  /** In the server's words. */
  readonly reasons: readonly string[];
  /** What each of them is called; absent where the case is older than these names. */
  readonly reason_codes?: readonly string[];
}

/** Neighbouring slices whose images have evenly spaced numbers. */
export interface ImageRun {
  /** The number of the first slice, from 1. */
  readonly slice: number;
  readonly count: number;
  /** The number of the first slice's image. */
  readonly number: number;
  /** What the number grows by from slice to slice. */
  readonly step: number;
}

/** A case that can be shown. Lengths are in mm, positions in LPS. */
export interface ReadyCase extends AnyCase {
  readonly state: "ready";
  /** Radius of the ball that closes the mask. */
  readonly closing_radius_mm: number;
  /** `envelope`: the mask is not closed. */
  readonly mask_kind: "brain" | "envelope";
  /** By how much the mask was made larger. */
  readonly offset_mm: number;
  /** The working grid: isotropic, along the patient's axes. */
  readonly grid: { readonly size: Vec3; readonly spacing_mm: number; readonly patient_from_voxel: Affine };
  /** The volume as it was acquired. */
  readonly volume: {
    readonly size: Vec3;
    readonly spacing_mm: Vec3;
    readonly patient_from_voxel: Affine;
    /** The scanner's name of the sequence, with its times. */
    readonly sequence?: string;
    /** Numbers of slices that were missing. */
    readonly interpolated_slices?: readonly number[];
    /** Of the DICOM series. */
    readonly series_number?: number;
    /** Which DICOM images are slices. */
    readonly images?: readonly ImageRun[];
  };
  readonly max_depth_mm: number;
  readonly envelope_ml: number;
  /** What zoom 1 fits into a picture. */
  readonly envelope_sphere: Sphere;
  readonly midsagittal: MirrorPlane;
  /** The faces of the volume that cut the brain, their normals into the volume; absent if none does. */
  readonly cuts?: readonly MirrorPlane[];
  readonly intensity: Intensity;
  readonly quality?: Quality;
  /** `dicom`, where it was made of such files. */
  readonly links?: { readonly dicom?: string };
}

export type Case = WaitingCase | FailedCase | ReadyCase;

/** A case in the list, with what the list alone states. */
export type Listed = Case & {
  readonly status: "preparing" | "failed" | "new" | "begun" | "signed";
  /** How many places of its maps stand out; absent if that is not known. */
  readonly places?: number;
  /** Without places that were dismissed. */
  readonly finding_count: number;
  /** Who has written findings. */
  readonly readers?: readonly string[];
  /** The names of its layers. */
  readonly layers?: readonly string[];
};
