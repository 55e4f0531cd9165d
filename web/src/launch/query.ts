// The query of the address. It names a patient's study: this module is the first to run, and takes it out of the address
// and of the history of the browser.

export const launchQuery = location.search;
history.replaceState(null, "", location.pathname);
