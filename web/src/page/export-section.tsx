// The section of the panel that saves and shares what is on the screen.

import { useState } from "preact/hooks";

import { t } from "../base/i18n.ts";
import { replaceAddress } from "../store/address.ts";
import { type OnScreen, copied, copyPicture, savePicture } from "./export.ts";
import { Button, Choice, type OfStore, Row, Section } from "./fields.tsx";
import { seriesDialog } from "./series.tsx";
import { serverPictureDialog } from "./server-picture.tsx";

/** How many times the screen's pixels a saved picture can have. */
const TIMES = [1, 2, 4] as const;
type Times = (typeof TIMES)[number];

export function ExportSection({ store, onScreen }: OfStore & { onScreen(): OnScreen }) {
  const [times, setTimes] = useState<Times>(1);
  const [note, say] = useState("");
  /** Reports in words what becomes of a file. */
  const telling = (words: string, work: () => Promise<string>) => (
    <Button
      onClick={() => {
        say(t("export.working"));
        void work().then(say);
      }}
    >
      {words}
    </Button>
  );
  const copyAddress = (): Promise<string> => {
    replaceAddress(store.view.now, store.shown);
    return copied(location.href);
  };
  return (
    <Section title="panel.export" data-task="case">
      <Row>
        <Choice
          id="times"
          label={t("export.times")}
          values={TIMES}
          value={times}
          words={(one) => `${one}×`}
          onChoose={(one) => setTimes(one)}
        />
        {telling(t("export.screenshot"), () => savePicture(onScreen(), times))}
        {telling(t("export.copy-picture"), () => copyPicture(onScreen(), times))}
        <Button onClick={() => serverPictureDialog(onScreen())}>{t("export.server")}</Button>
        <Button onClick={() => seriesDialog(onScreen(), store.sweep.choice.peek())}>{t("export.series")}</Button>
        {telling(t("export.copy"), copyAddress)}
      </Row>
      <p class="quiet" role="status">
        {note}
      </p>
    </Section>
  );
}
