"""Adds a button to the studies and series of the old explorer of Orthanc that opens their case in Isocortex, in a tab of its own.

Orthanc runs this with its Python plugin. ISOCORTEX_PAGE is the address of Isocortex for the browser; by default, port 8640 of the
host of Orthanc's own page.
"""

import json
import os

import orthanc

PAGE = json.dumps(os.environ.get("ISOCORTEX_PAGE", ""))

orthanc.ExtendOrthancExplorer("""
["study", "series"].forEach(function (level) {
  $("#" + level).live("pagebeforecreate", function () {
    var button = $("<a>").attr("data-role", "button").attr("href", "#").attr("data-icon", "search").attr("data-theme", "e");
    button.text("Open in Isocortex").insertBefore($("#" + level + "-delete").parent().parent());
    button.click(function (event) {
      event.preventDefault();
      if (!$.mobile.pageData) return;
      var page = %s || location.protocol + "//" + location.hostname + ":8640";
      // Opened at once, because a browser allows it only during the click.
      var tab = window.open("", "_blank");
      tab.opener = null;
      $.getJSON("../" + (level === "study" ? "studies" : "series") + "/" + $.mobile.pageData.uuid, function (found) {
        var query = function (study, series) {
          return "study=" + encodeURIComponent(study) + (series ? "&series=" + encodeURIComponent(series) : "");
        };
        var go = function (text) { tab.location = page.replace(/\\/$/, "") + "/launch?" + text; };
        var tags = found.MainDicomTags;
        if (level === "study") return go(query(tags.StudyInstanceUID));
        $.getJSON("../studies/" + found.ParentStudy, function (study) {
          go(query(study.MainDicomTags.StudyInstanceUID, tags.SeriesInstanceUID));
        });
      });
    });
  });
});
""" % PAGE)
