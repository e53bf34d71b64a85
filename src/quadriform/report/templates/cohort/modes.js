// Modes of shape: the viewer's control points are displaced by so many sigmas of each.

{
  const $ = (id) => document.getElementById(id), given = JSON.parse($("mode-data").textContent);
  const along = new Float32Array(Uint8Array.from(atob(given.modes), (c) => c.charCodeAt(0)).buffer);
  const count = given.variances.length, size = along.length / count;
  const sliders = given.variances.map((_, m) => $(`mode-${m + 1}`));

  const shape = () => {
    const by = new Float64Array(size);
    sliders.forEach((slider, m) => {
      const sigmas = Number(slider.value);
      $(`sigma-${m + 1}`).textContent = String(sigmas);
      for (let i = 0; i < size; i++) by[i] += sigmas * along[m * size + i];
    });
    window.quadriform.displace(by);
  };

  const toMean = () => { for (const slider of sliders) slider.value = 0; shape(); };
  for (const slider of sliders) slider.addEventListener("input", shape);
  for (const id of ["to-mean", "undo"]) $(id).addEventListener("click", toMean);
}
