// Modes of shape: what the viewer's control points are moved by, so many sigmas of each.

{
  const given = JSON.parse(document.getElementById("mode-data").textContent);
  const along = new Float32Array(bytes(given.modes)), sliders = given.shares.map((_, m) => $(`mode-${m + 1}`));
  let rest = 0;

  const shape = () => {
    edits.fill(0);
    sliders.forEach((slider, m) => {
      const sigmas = Number(slider.value);
      $(`sigma-${m + 1}`).textContent = String(sigmas);
      for (let i = 0; i < size; i++) edits[i] += sigmas * along[m * size + i];
    });
    moving();
    clearTimeout(rest);
    rest = setTimeout(numbers, 200);
  };

  const toMean = () => { sliders.forEach((slider) => { slider.value = 0; }); shape(); };
  for (const slider of sliders) slider.addEventListener("input", shape);
  $("to-mean").addEventListener("click", toMean);
  $("undo").addEventListener("click", toMean);
}
