"use strict";
// The page works without this; it only adds copying and the switches for the lines.
for (const button of document.querySelectorAll("button.copy")) {
  button.addEventListener("click", () => {
    const text = button.closest("tr").querySelector("pre").textContent;
    const done = () => {
      button.textContent = "copied";
      setTimeout(() => { button.textContent = "copy"; }, 1200);
    };
    if (navigator.clipboard) {
      navigator.clipboard.writeText(text).then(done);
    } else {
      const range = document.createRange();
      range.selectNodeContents(button.closest("tr").querySelector("pre"));
      getSelection().removeAllRanges();
      getSelection().addRange(range);
    }
  });
}
for (const kind of ["arm", "mask"]) {
  const box = document.getElementById(`show-${kind}`);
  box?.addEventListener("change", () => {
    document.body.classList.toggle(`no-${kind}`, !box.checked);
  });
}
