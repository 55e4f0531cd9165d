// What rejection notes have rejected, who and when, and the button that lifts it.

import { useEffect, useState } from "preact/hooks";

import { ask, send } from "../base/api.ts";
import { moment, number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { Button, Status } from "./fields.tsx";

interface Rejection {
  readonly id: string;
  readonly images: number;
  readonly by: string;
  readonly at: string;
}

/** The rejections that stand; nothing if there is none. */
export function Rejections({ lifted }: { lifted(): void }) {
  const [rejections, setRejections] = useState<readonly Rejection[]>([]);
  const [said, say] = useState("");
  const complain = (problem: unknown): void => say(problemWords(problem));

  useEffect(() => {
    ask<{ readonly rejections: readonly Rejection[] }>("v1/rejections").then(
      (answer) => setRejections(answer.rejections),
      complain,
    );
  }, []);
  const lift = async ({ id }: Rejection): Promise<void> => {
    await send(`v1/rejections/${id}`, { method: "DELETE" });
    setRejections((all) => all.filter((one) => one.id !== id));
    say(t("rejections.lifted"));
    lifted();
  };
  return (
    <>
      {rejections.length > 0 && (
        <details class="rejections">
          <summary>{t("rejections.title", { count: number(rejections.length) })}</summary>
          <p class="quiet">{t("rejections.text")}</p>
          <ul>
            {rejections.map((one) => (
              <li key={one.id} data-id={one.id}>
                {t("rejections.one", { count: number(one.images), by: one.by, at: moment(one.at) })}{" "}
                <Button onClick={() => void lift(one).catch(complain)}>{t("rejections.lift")}</Button>
              </li>
            ))}
          </ul>
        </details>
      )}
      <Status words={said} />
    </>
  );
}
