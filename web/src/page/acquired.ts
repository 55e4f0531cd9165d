// Slices of what was acquired, for a case that has nothing else to show yet.

import { getPicture } from "../base/api.ts";
import { h } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import { decoded } from "../base/picture.ts";
import { PLANE_NAMES } from "../model/query.ts";

export class AcquiredSlices {
  readonly element = h("div", { class: "acquired" });
  #shown = "";

  /** Shows those of a case; of none if its id is empty. */
  async show(id: string): Promise<void> {
    if (this.#shown === id) return;
    this.#shown = id;
    this.element.replaceChildren();
    for (const plane of id ? PLANE_NAMES : []) {
      // Without a picture there are still the words.
      const image = await getPicture(`${id}/acquired/${plane}?annotate=true`).then(decoded, () => null);
      if (!image || this.#shown !== id) return;
      image.alt = t(`plane.${plane}`);
      this.element.append(image);
    }
  }
}
