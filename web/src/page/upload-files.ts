// Which of the chosen files is what: pure.

import type { Key } from "../base/i18n.ts";

/** What of a file is looked at. */
interface Named {
  readonly name: string;
  readonly size: number;
}

export interface Sorted<F extends Named> {
  /** NIfTI, or a zip of DICOM. */
  readonly volume: F | null;
  readonly mask: F | null;
  /** The files of a series. */
  readonly dicom: readonly F[];
  /** Why these cannot be sent; null where they can. */
  readonly trouble: Key | null;
}

const isNifti = ({ name }: Named): boolean => /\.nii(\.gz)?$/i.test(name);
const isZip = ({ name }: Named): boolean => /\.zip$/i.test(name);
/** Whether a file's name says that it is a mask. */
export const looksLikeMask = ({ name }: Named): boolean => /mask|bet|brain|seg|label|mascara|máscara/i.test(name);
/** What systems leave beside a series. */
const isLitter = ({ name, size }: Named): boolean =>
  size === 0 || /^\.|^(DICOMDIR|thumbs\.db|desktop\.ini)$|\.(txt|xml|json|md|pdf|jpe?g|png)$/i.test(name);

/** Sorts files; `mask` is one that was chosen as such. */
export function sortFiles<F extends Named>(files: readonly F[], mask: F | null): Sorted<F> {
  const nifti = files.filter(isNifti);
  const zips = files.filter(isZip);
  const rest = files.filter((file) => !isNifti(file) && !isZip(file) && !isLitter(file));
  const refused = (trouble: Key): Sorted<F> => ({ volume: null, mask, dicom: [], trouble });
  if (files.length === 0) return refused("upload.nothing");
  if (nifti.length + zips.length === 0) {
    // A single file of another kind is sent as the volume: the server says what it is not.
    if (rest.length === 1) return { volume: rest[0] ?? null, mask, dicom: [], trouble: null };
    return rest.length > 0 ? { volume: null, mask, dicom: rest, trouble: null } : refused("upload.nothing");
  }
  const most = mask ? 1 : 2;
  if (zips.length > 1 || nifti.length + zips.length > most) return refused("upload.too-many");
  if (zips.length === 1) return { volume: zips[0] ?? null, mask: mask ?? nifti[0] ?? null, dicom: [], trouble: null };
  if (nifti.length === 1) return { volume: nifti[0] ?? null, mask, dicom: [], trouble: null };
  const [a, b] = nifti as [F, F];
  // The one that is called so; where both or none is, the smaller: a mask compresses well.
  const maskFirst = looksLikeMask(a) === looksLikeMask(b) ? a.size < b.size : looksLikeMask(a);
  return maskFirst
    ? { volume: b, mask: a, dicom: [], trouble: null }
    : { volume: a, mask: b, dicom: [], trouble: null };
}

/** A name that says what the file is, and nothing of the patient. */
export function uploadName(part: string, name: string): string {
  const ending = /(\.nii\.gz|\.nii|\.zip|\.gz)$/i.exec(name)?.[0].toLowerCase();
  return part + (ending ?? "");
}
