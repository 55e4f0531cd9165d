// Which of the chosen files is what: pure.

import type { Key } from "../base/i18n.ts";
import type { LayerKind } from "../model/layers.ts";

/** What of a file is looked at. */
interface Named {
  readonly name: string;
  readonly size: number;
}

export interface Sorted<F extends Named> {
  /** NIfTI, or a zip of DICOM. */
  readonly volume: F | null;
  readonly mask: F | null;
  /** DICOM, or the files of a FreeSurfer subject. */
  readonly dicom: readonly F[];
  /** Further volumes of the same head. */
  readonly layers: readonly F[];
  /** Why these cannot be sent; null where they can. */
  readonly trouble: Key | null;
}

/** NIfTI, or MGH, which is taken wherever NIfTI is. */
const isNifti = ({ name }: Named): boolean => /\.(nii(\.gz)?|mgh|mgz)$/i.test(name);
const isZip = ({ name }: Named): boolean => /\.zip$/i.test(name);
/** Whether a file's name says that it is a mask. */
export const looksLikeMask = ({ name }: Named): boolean => /mask|bet|brain|seg|label|mascara|máscara/i.test(name);
/** What systems leave beside a series. */
const isLitter = ({ name, size }: Named): boolean =>
  size === 0 || /^\.|^(DICOMDIR|thumbs\.db|desktop\.ini)$|\.(txt|xml|json|md|pdf|jpe?g|png)$/i.test(name);

/** The paths of what is read of the folder of a FreeSurfer subject; no other file has a folder in its name. */
const SUBJECT =
  /(mri\/(T1|orig|nu|\w*mask|aparc.*)\.mgz|surf\/.h\.(white|pial|thickness|curv|sulc)|label\/.h\.aparc.*annot)$/;

/** A file at a path in a folder: what is of a subject has that path for its name, which tells subjects apart. */
export const ofSubject = (file: File, path: string): File => (SUBJECT.test(path) ? new File([file], path) : file);

/** Sorts files; `mask` is one that was chosen as such. */
export function sortFiles<F extends Named>(files: readonly F[], mask: F | null): Sorted<F> {
  const nifti = files.filter(isNifti);
  const zips = files.filter(isZip);
  const rest = files.filter((file) => !isNifti(file) && !isZip(file) && !isLitter(file));
  const sorted = (part: Partial<Sorted<F>>): Sorted<F> => ({
    volume: null,
    mask,
    dicom: [],
    layers: [],
    trouble: null,
    ...part,
  });
  const subject = files.filter(({ name }) => SUBJECT.test(name));
  const folders = new Set(subject.map(({ name }) => name.replace(SUBJECT, "")));
  if (folders.size > 1) return sorted({ trouble: "upload.too-many" });
  if (folders.size > 0) return sorted({ dicom: subject });
  if (nifti.length + zips.length === 0) {
    const [volume, another] = rest;
    if (!volume) return sorted({ trouble: "upload.nothing" });
    // A single file of another kind is sent as the volume: the server says what it is not.
    return sorted(another ? { dicom: rest } : { volume });
  }
  const several = zips.length === 0 && severalOf(nifti, mask);
  if (several) return sorted(several);
  const most = mask ? 1 : 2;
  if (zips.length > 1 || nifti.length + zips.length > most) return sorted({ trouble: "upload.too-many" });
  const [[zip], [first, second]] = [zips, nifti];
  if (zip) return sorted({ volume: zip, mask: mask ?? first ?? null });
  if (!first || !second) return sorted({ volume: first ?? null });
  // The one that is called so; where both or none is, the smaller: a mask compresses well.
  const isFirst = looksLikeMask(first) === looksLikeMask(second) ? first.size < second.size : looksLikeMask(first);
  return sorted(isFirst ? { volume: second, mask: first } : { volume: first, mask: second });
}

/**
 * The T1 among several NIfTI files of one head, its mask, and the others, which can be its layers; null where there are
 * none of these, or not one of them alone is called a T1.
 */
function severalOf<F extends Named>(nifti: readonly F[], mask: F | null): Partial<Sorted<F>> | null {
  const isT1 = (file: F): boolean => sequenceOf(file)?.name === "T1";
  const [volume, another] = nifti.filter((file) => isT1(file) && !looksLikeMask(file));
  const others = nifti.filter((file) => file !== volume);
  const own = mask ? null : (others.find((file) => looksLikeMask(file) && sequenceOf(file)?.kind !== "labels") ?? null);
  const layers = others.filter((file) => file !== own);
  if (!volume || another || layers.length === 0 || (nifti.length === 2 && !layers.every(sequenceOf))) return null;
  return { volume, mask: mask ?? own, layers };
}

/** The volumes of layers among files, each of them one file or all files of DICOM, and a text with names of labels. */
export function sortLayers<F extends Named>(
  files: readonly F[],
): { readonly volumes: readonly (readonly F[])[]; readonly labels: F | null } {
  const single = files.filter((file) => isNifti(file) || isZip(file));
  const labels = files.find(({ name }) => /\.(txt|csv|ctab)$/i.test(name)) ?? null;
  const rest = files.filter((file) => !single.includes(file) && file !== labels && !isLitter(file));
  return { volumes: [...single.map((file) => [file]), ...(rest.length > 0 ? [rest] : [])], labels };
}

/** What the name of a file says of its volume: nothing that is in none of these lists goes on. */
const SEQUENCES: readonly (readonly [RegExp, string, LayerKind])[] = [
  [/label|seg|atlas|aparc|aseg|prediction|cluster/i, "labels", "labels"],
  [/pet|fdg/i, "PET", "pet"],
  [/(^|[^a-z])ct([^a-z]|$)/i, "CT", "ct"],
  [/[zt]-?_?(map|stat)|spm[ft]|prob/i, "map", "map"],
  [/flair/i, "FLAIR", "mr"],
  [/t2/i, "T2", "mr"],
  [/swi/i, "SWI", "mr"],
  [/dir([^a-z]|$)/i, "DIR", "mr"],
  [/t1|mprage/i, "T1", "mr"],
];

/** The sequence and the kind that a file's name tells, if it is a NIfTI: DICOM has both in its header. */
export function sequenceOf(file: Named): { readonly name: string; readonly kind: LayerKind } | null {
  const found = isNifti(file) ? SEQUENCES.find(([pattern]) => pattern.test(file.name.replace(/.*\//, ""))) : undefined;
  return found ? { name: found[1], kind: found[2] } : null;
}

/** A name that no other has: the wanted one, or that with a number. */
export function freeName(wanted: string, taken: readonly string[]): string {
  for (let number = 1; ; number += 1) {
    const name = number === 1 ? wanted : `${wanted} ${number}`;
    if (!taken.includes(name)) return name;
  }
}

/** The name of one of several files: a number, or its path in the folder of its subject. */
export const partName = (name: string, index: number): string => SUBJECT.exec(name)?.[0] ?? `${index + 1}.dcm`;

/** A name that says what the file is, and nothing of the patient. */
export function uploadName(part: string, name: string): string {
  const ending = /(\.nii\.gz|\.nii|\.mg[hz]|\.zip|\.gz)$/i.exec(name)?.[0].toLowerCase();
  return part + (ending ?? "");
}
