// What a page does: switches, labels, the view, light and dark, and the time of a recording.
(() => {
  const page = JSON.parse(document.getElementById("tp-data").textContent);
  const root = document.documentElement;
  const vector = () => viewer.camera.position.clone();
  const inThree = ([x, y, z]) => vector().set(x, z, -y); // Meshcat's world has z up, that of three.js y.

  // Every mesh of the scene with its path; recordings show and hide what is above them.
  function leaves(node, path, found) {
    for (const [name, child] of Object.entries(node.children)) {
      if (name === "<object>") found.push([path, child.object]);
      else leaves(child, `${path}/${name}`, found);
    }
    return found;
  }

  // What each box of legend and tables says, by what it hides; tables change with the time of a recording.
  const isOn = new Map();
  const boxes = () => [...document.querySelectorAll("[data-hides]")];
  const isPart = (box, group) => box !== group && box.dataset.hides.startsWith(group.dataset.hides);
  function readBoxes() {
    for (const box of boxes()) {
      if (isOn.has(box.dataset.hides)) box.checked = isOn.get(box.dataset.hides);
      else isOn.set(box.dataset.hides, box.checked);
    }
    // A legend's entry that stands for the rows of a table is on where one of them is.
    for (const group of boxes()) {
      const parts = boxes().filter((box) => isPart(box, group));
      if (parts.length) setBox(group, parts.some((box) => box.checked));
    }
  }
  function setBox(box, on) {
    box.checked = on;
    isOn.set(box.dataset.hides, on);
  }
  function onBox(event) {
    const box = event.target;
    if (box.dataset.hides) {
      setBox(box, box.checked);
      for (const part of boxes().filter((other) => isPart(other, box))) setBox(part, box.checked);
      readBoxes();
    }
    applySwitches();
  }

  function applySwitches() {
    const off = [...isOn].filter(([, on]) => !on).map(([hides]) => new RegExp(hides));
    const thin = document.getElementById("tp-see-through");
    for (const [path, object] of leaves(viewer.scene_tree, "", [])) {
      if (!path.startsWith("/tactopose") && !path.startsWith("/drake")) continue;
      object.visible = !off.some((pattern) => pattern.test(path));
      if (thin && new RegExp(thin.dataset.thins).test(path)) {
        object.traverse((part) => {
          if (!part.material) return;
          part.material.transparent = thin.checked;
          part.material.opacity = thin.checked ? 0.3 : 1.0;
          part.material.needsUpdate = true;
        });
      }
    }
    viewer.set_dirty();
  }

  // The nearest camera along the page's direction that sees all of its points.
  function frame() {
    const camera = viewer.camera, fov = 34;
    if (!camera.isPerspectiveCamera || !page.view) return;
    camera.fov = fov;
    const aspect = viewer.dom_element.offsetWidth / Math.max(viewer.dom_element.offsetHeight, 1);
    const forward = inThree(page.view.direction).normalize().negate();
    const right = forward.clone().cross(vector().set(0, 1, 0)).normalize();
    const up = right.clone().cross(forward);
    const slope = 0.9 * Math.tan((fov * Math.PI) / 360);
    const slopes = [slope * aspect, slope];
    const high = [-Infinity, -Infinity], low = [Infinity, Infinity];
    let depth = 0;
    for (const point of page.view.points.map(inThree)) {
      const along = point.dot(forward);
      depth += along / page.view.points.length;
      [point.dot(right), point.dot(up)].forEach((x, k) => {
        high[k] = Math.max(high[k], x - slopes[k] * along);
        low[k] = Math.min(low[k], x + slopes[k] * along);
      });
    }
    // high is the largest x - s z, low the smallest x + s z; at distance d both edges fit where d = (high - low) / 2 s.
    const back = Math.max(...[0, 1].map((k) => (high[k] - low[k]) / (2 * slopes[k])));
    const at = right.multiplyScalar(0.5 * (high[0] + low[0])).add(up.multiplyScalar(0.5 * (high[1] + low[1])));
    const eye = at.clone().addScaledVector(forward, -back);
    camera.position.copy(eye);
    viewer.controls.target.copy(at.addScaledVector(forward, depth));
    viewer.controls.update();
    camera.updateProjectionMatrix();
    viewer.set_dirty();
  }

  // Dark blue regions would not be seen on a dark ground.
  function setRegions(isDark) {
    for (const [path, object] of leaves(viewer.scene_tree, "", [])) {
      if (!path.startsWith("/tactopose/estimate/uncertainty/")) continue;
      object.traverse(({ material }) => {
        if (!material) return;
        material.userData.light ??= material.color.clone();
        material.color.copy(material.userData.light);
        if (isDark) material.color.lerp(material.color.clone().set("#ffffff"), 0.35);
      });
    }
  }
  function setTheme(theme) {
    root.dataset.theme = theme;
    setRegions(theme === "dark");
    const [top, bottom] = theme === "dark" ? [[0.13, 0.16, 0.2], [0.06, 0.08, 0.1]] : [[0.975, 0.98, 0.99], [0.87, 0.89, 0.92]];
    viewer.set_property(["Background", "<object>"], "top_color", top);
    viewer.set_property(["Background", "<object>"], "bottom_color", bottom);
    viewer.set_dirty();
  }

  const labels = page.labels.map((label) => {
    const element = document.createElement("div");
    element.className = "tp-label";
    element.textContent = label.text;
    document.body.appendChild(element);
    return { ...label, element };
  });
  function isShown(object) {
    for (let at = object; at; at = at.parent) if (!at.visible) return false;
    return true;
  }
  function moveLabels() {
    const width = viewer.dom_element.offsetWidth, height = viewer.dom_element.offsetHeight;
    viewer.camera.updateMatrixWorld();
    viewer.scene.updateMatrixWorld();
    const taken = [];
    for (const { path, colour, element, at: place } of labels) {
      const node = viewer.scene_tree.find(path.split("/").filter(Boolean));
      const mesh = leaves(node, "", []).map(([, object]) => object).find(isShown);
      const at = node.object.localToWorld(vector().fromArray(place)).project(viewer.camera);
      const shown = mesh && Math.abs(at.z) < 1 && Math.abs(at.x) < 1 && Math.abs(at.y) < 1;
      element.style.display = shown ? "" : "none";
      if (!shown) continue;
      element.style.color = node.children["false"]?.object.visible ? page.falseColour : colour;
      const wide = element.offsetWidth, high = element.offsetHeight;
      const x = Math.min((0.5 + 0.5 * at.x) * width + 7, width - wide - 4);
      const y = (0.5 - 0.5 * at.y) * height - 20;
      // The nearest place above or below at which no other text stands.
      const isFree = (top) => !taken.some((other) => Math.abs(other.x - x) < (x < other.x ? wide : other.wide) && Math.abs(other.y - top) < high - 3);
      const top = [0, -1, 1, -2, 2, -3, 3].map((step) => y + step * (high - 2)).find(isFree) ?? y;
      taken.push({ x, y: top, wide });
      element.style.transform = `translate(${x}px, ${top}px)`;
    }
  }

  // The time of a recording: the page drives Meshcat's animation itself.
  const slider = document.getElementById("tp-time");
  let playedFrom = null, lastSaid = null;
  function setTime(time) {
    const said = page.timeline.said.findLast((instant) => instant.from <= time + 1e-9) ?? page.timeline.said[0];
    // The scene stays as it was at the last moment that was recorded; moments are rounded to a millisecond.
    const drawn = said ? said.from + 0.5e-3 : time;
    for (const action of viewer.animator.actions) {
      action.enabled = true;
      action.paused = false;
      action.time = Math.min(drawn, action.getClip().duration);
    }
    viewer.animator.mixer.update(0);
    slider.value = time;
    document.getElementById("tp-seconds").textContent = `${time.toFixed(2)} s`;
    if (said && said !== lastSaid) {
      for (const part of ["said", "hypotheses", "contacts"]) document.getElementById(`tp-${part}`).innerHTML = said[part];
      for (const { free, element } of labels) if (free !== null) element.textContent = said.free[free] ?? "";
      lastSaid = said;
      readBoxes();
    }
    const status = page.timeline.strip.findLast((piece) => piece.from <= time + 1e-9) ?? page.timeline.strip[0];
    document.getElementById("tp-now").textContent = status.text;
    for (const cursor of document.querySelectorAll(".tp-cursor")) cursor.style.left = `${(100 * time) / page.timeline.end}%`;
    viewer.set_dirty();
  }
  function step(now) {
    if (playedFrom === null) return;
    const time = playedFrom.time + (now - playedFrom.now) / 1000;
    setTime(Math.min(time, page.timeline.end));
    if (time < page.timeline.end) requestAnimationFrame(step);
    else setPlaying(false);
  }
  function setPlaying(is) {
    document.getElementById("tp-play").textContent = is ? "Pause" : "Play";
    const time = Number(slider.value) < page.timeline.end - 1e-3 ? Number(slider.value) : 0;
    playedFrom = is ? { time, now: performance.now() } : null;
    if (is) requestAnimationFrame(step);
  }
  function startTimeline() {
    const animator = viewer.animator;
    animator.play();
    animator.playing = false;
    slider.addEventListener("input", () => { setPlaying(false); setTime(Number(slider.value)); });
    document.getElementById("tp-play").addEventListener("click", () => setPlaying(playedFrom === null));
    setTime(page.timeline.end);
  }

  let resized = null;
  function start() {
    Object.assign(viewer.gui.domElement.style, { display: "none", right: "var(--side)" });
    viewer.set_property(["Grid"], "visible", false);
    viewer.set_property(["Axes"], "visible", false);
    setTheme(window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
    readBoxes();
    applySwitches();
    if (slider) startTimeline();
    viewer.set_3d_pane_size();
    frame();
    document.getElementById("tp-side").addEventListener("change", onBox);
    document.getElementById("tp-frame").addEventListener("click", frame);
    document.getElementById("tp-theme").addEventListener("click", () => setTheme(root.dataset.theme === "dark" ? "light" : "dark"));
    document.getElementById("tp-expert").addEventListener("click", () => {
      const style = viewer.gui.domElement.style;
      style.display = style.display === "none" ? "" : "none";
    });
    window.addEventListener("resize", () => { clearTimeout(resized); resized = setTimeout(frame, 60); });
    const render = viewer.render.bind(viewer);
    viewer.render = () => { render(); moveLabels(); };
    viewer.render();
    root.dataset.ready = "yes";
  }
  const wait = () => (tactoposeTold >= page.commands ? start() : setTimeout(wait, 20));
  wait();
})();
