// Adding layers to a case: files under fixed names, what they are and how they are to be placed.

import { type Observe, type Uploaded, upload } from "../base/api.ts";
import type { Layer, LayerKind } from "../model/layers.ts";
import type { Affine } from "../model/space.ts";
import { sequenceOf, uploadName } from "./upload-files.ts";

/** What is said of a new layer besides its files; what is not said the server finds out. */
interface LayerWish {
  readonly name?: string;
  readonly kind?: LayerKind;
  readonly unit?: string;
  readonly transform?: string | Affine;
  /** The token of a series among DICOM files. */
  readonly series?: string;
}

/** A volume that can be added as a layer. */
export interface Offer {
  readonly title: string;
  readonly files: readonly File[];
  readonly wish: LayerWish;
}

/** Sends one layer: a volume in a file, or the files of DICOM. */
export function sendLayer(
  id: string,
  files: readonly File[],
  wish: LayerWish,
  labels: Blob | null,
  [signal, observe]: readonly [AbortSignal, Observe],
): Promise<Uploaded<Layer>> {
  const body = new FormData();
  body.append("parameters", new Blob([JSON.stringify(wish)], { type: "application/json" }));
  const [only] = files;
  if (only && files.length === 1) body.append("volume", only, uploadName("volume", only.name));
  else files.forEach((file, index) => body.append("dicom", file, `${index + 1}.dcm`));
  if (labels) body.append("labels", labels, "labels.txt");
  return upload(`v1/cases/${id}/layers`, body, signal, observe);
}

/** What the name of a file says, where nothing else was chosen. */
export function wishOf(files: readonly File[], chosen: LayerWish): LayerWish {
  const [only] = files;
  const guessed = only && files.length === 1 ? sequenceOf(only) : null;
  return { ...guessed, ...chosen };
}
