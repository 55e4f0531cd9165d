// Pictures that the server draws, and the dialogs that show one.

import { useEffect, useRef, useState } from "preact/hooks";

import { getPicture } from "../base/api.ts";
import { number, t } from "../base/i18n.ts";
import { decoded } from "../base/picture.ts";
import { problemWords } from "../base/problem-words.ts";
import { pictureSize, renderQuery } from "../model/query.ts";
import { isHalved } from "../model/state.ts";
import { open } from "./dialogs.tsx";
import { type OnScreen, copied } from "./export.ts";
import { Button, Placed, Quiet } from "./fields.tsx";

/** A picture of the server; why there is none, if it cannot be had; null until either is known, or if none is wanted. */
export type Drawn = HTMLImageElement | { readonly trouble: string } | null;

/** The latest picture that `load` resolves to, which is asked for whenever `key` changes. */
export function useDrawn(key: string, load: () => Promise<Blob | null>): Drawn {
  const [drawn, setDrawn] = useState<Drawn>(null);
  useEffect(() => {
    let isWanted = true;
    const take = (found: Drawn): void => void (isWanted && setDrawn(found));
    setDrawn(null);
    load()
      .then((blob) => blob && decoded(blob))
      .then(take, (problem) => take({ trouble: problemWords(problem) }));
    return () => void (isWanted = false);
  }, [key]);
  return drawn;
}

interface ShotProps {
  readonly drawn: Drawn;
  readonly alt: string;
  /** What stands there until the picture does. */
  readonly words: string;
  readonly name?: string;
}

export const Shot = ({ drawn, alt, words, name = "" }: ShotProps) => (
  <div class="server-shot" data-shown={drawn instanceof HTMLImageElement ? name : ""}>
    {drawn instanceof HTMLImageElement ? (
      <Placed node={drawn} alt={alt} />
    ) : (
      <p class={drawn ? "bad" : "quiet"}>{drawn ? drawn.trouble : words}</p>
    )}
  </div>
);

/** A picture of a case; `path` begins with the id of the case. */
export function ServerPicture({ path, alt, onSeen }: { readonly path: string; readonly alt: string; onSeen?(): void }) {
  const drawn = useDrawn(path, () => getPicture(path));
  useEffect(() => {
    if (drawn instanceof HTMLImageElement) onSeen?.();
  }, [drawn]);
  return <Shot drawn={drawn} alt={alt} words={t("server.waiting")} />;
}

/** The server's own picture of a state, and its address to copy. */
export function serverPictureDialog({ shown: { id }, state, surface }: OnScreen): void {
  const query = renderQuery(surface.surface.served(state), pictureSize(surface.size(), devicePixelRatio, 1024));
  query.set("annotate", "true");
  const path = `${id}/render?${query}`;
  const depth = number(state.depth_mm, 1);
  void open(
    t("server.title", { depth }),
    "server-picture",
    <>
      <ServerPicture path={path} alt={t("server.alt", { depth })} />
      {isHalved(state) && <Quiet>{t(state.beside ? "server.right" : "server.half")}</Quiet>}
      <Address value={new URL(`v1/cases/${path}`, document.baseURI).href} />
    </>,
  );
}

/** An address to copy; it can be selected where the browser forbids that. */
function Address({ value }: { readonly value: string }) {
  const [said, say] = useState("");
  const field = useRef<HTMLInputElement>(null);
  const copy = async (): Promise<void> => {
    const words = await copied(value);
    if (words === value) field.current?.select();
    else say(words);
  };
  return (
    <>
      <div class="line">
        <input type="text" id="server-address" aria-label={t("server.address")} readonly value={value} ref={field} />
        <Button onClick={() => void copy()}>{t("server.copy")}</Button>
      </div>
      <span class="quiet" role="status">
        {said}
      </span>
    </>
  );
}

/** Nine slices with the mask's outline, to judge it by. */
export function maskDialog(id: string): void {
  void open(t("quality.look"), "mask", <ServerPicture path={`${id}/quality`} alt={t("quality.alt")} />);
}
