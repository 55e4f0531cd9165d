// What of the page is fetched when it is first wanted, as one file: see `later.ts`.

export { askToken, confirmDelete, confirmRename, helpDialog, maskDialog, serverPictureDialog } from "./dialogs.ts";
export { captionOf, copied, copyPicture, fileStem, savePicture } from "./export.ts";
export { profileView } from "./chart.ts";
export { SlicePane } from "../panes/slices.ts";
export { CaseSection } from "./case-section.ts";
export { CaseMaps } from "./case-maps.ts";
export { MapsSection } from "./maps-section.ts";
export { SweepSection } from "./sweep-section.ts";
export { UploadForm } from "./upload.ts";
export { seriesDialog } from "./series.ts";
