// Tables: tabs, sorting, and a card that says what stands behind a method or a number.
"use strict";

(() => {
  const { data } = HarnessPage;
  const results = document.getElementById("results");
  const card = document.getElementById("card");

  // ---- tabs

  function makeTabs() {
    const panels = [...results.querySelectorAll(".panel")];
    const bar = results.querySelector(".tabs");
    if (panels.length < 2) return;
    bar.hidden = false;
    results.classList.add("tabbed");
    const tabs = panels.map((panel, index) => {
      const tab = document.createElement("button");
      tab.type = "button";
      tab.role = "tab";
      tab.id = `tab-${panel.id}`;
      tab.textContent = panel.querySelector("h3").textContent;
      tab.setAttribute("aria-controls", panel.id);
      panel.setAttribute("role", "tabpanel");
      tab.addEventListener("click", () => choose(index));
      return tab;
    });
    bar.append(...tabs);
    bar.addEventListener("keydown", ({ key }) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[key];
      if (!step) return;
      const now = tabs.indexOf(document.activeElement);
      choose((now + step + tabs.length) % tabs.length).focus();
    });
    const choose = (chosen) => {
      panels.forEach((panel, index) => panel.classList.toggle("shown", index === chosen));
      tabs.forEach((tab, index) => {
        tab.setAttribute("aria-selected", String(index === chosen));
        tab.tabIndex = index === chosen ? 0 : -1;
      });
      return tabs[chosen];
    };
    choose(0);
  }

  // ---- sorting

  function makeSortable(table) {
    for (const head of table.querySelectorAll("th.number")) {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        const upward = head.getAttribute("aria-sort") !== "ascending";
        sort(table, head, upward);
      });
    }
  }

  function sort(table, head, upward) {
    const column = [...head.parentElement.children].indexOf(head);
    const value = (body) => Number(body.rows[0].cells[column].dataset.value ?? NaN);
    const bodies = [...table.tBodies];
    bodies.sort((one, other) => {
      const apart = one.classList.contains("apart") - other.classList.contains("apart");
      const [a, b] = [value(one), value(other)];
      if (Number.isNaN(a) || Number.isNaN(b)) return apart || Number.isNaN(a) - Number.isNaN(b);
      return apart || (upward ? a - b : b - a);
    });
    table.append(...bodies);
    for (const other of head.parentElement.children) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", upward ? "ascending" : "descending");
  }

  // ---- stages: many rows, shown where they are asked for

  function makeFoldable(table) {
    if (!table.querySelector("tr.stage")) return;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "fold";
    const fold = (isOpen) => {
      table.classList.toggle("folded", !isOpen);
      button.setAttribute("aria-expanded", String(isOpen));
      button.textContent = isOpen ? "Hide stages" : "Show stages";
    };
    button.addEventListener("click", () => fold(table.classList.contains("folded")));
    fold(false);
    table.closest(".scroll").before(button);
  }

  // ---- the card

  let pinned = null, leaving = 0;

  function openCard(anchor, content, isPinned) {
    clearTimeout(leaving);
    if (pinned && !isPinned) return;
    pinned = isPinned ? anchor : null;
    card.replaceChildren(...content);
    card.hidden = false;
    card.scrollTop = 0;
    const box = anchor.getBoundingClientRect(), own = card.getBoundingClientRect();
    const below = box.bottom + 6 + own.height < innerHeight || box.top < own.height + 12;
    const left = Math.max(8, Math.min(box.left, innerWidth - own.width - 8));
    card.style.left = `${left + scrollX}px`;
    card.style.top = `${(below ? box.bottom + 6 : box.top - own.height - 6) + scrollY}px`;
  }

  function closeCard() {
    card.hidden = true;
    const back = pinned;
    pinned = null;
    return back;
  }

  const closeSoon = () => { if (!pinned) leaving = setTimeout(closeCard, 180); };

  function methodContent(name) {
    const source = document.getElementById(`method-${name}`);
    const title = document.createElement("h3");
    title.textContent = source.querySelector("summary").firstChild.textContent;
    const body = source.querySelector(".card-body").cloneNode(true);
    return [title, body];
  }

  function numberContent(cell) {
    const { method, column } = cell.dataset;
    const name = cell.closest("table").dataset.table;
    const { columns, rows } = data.tables[name];
    const title = document.createElement("h3");
    const summary = document.getElementById(`method-${method}`).querySelector("summary");
    title.textContent = `${summary.firstChild.textContent.trim()}, ${columns[column].title}`;
    const values = rows[cell.closest("tbody").dataset.row][column] ?? {};
    const list = document.createElement("table");
    list.className = "behind";
    for (const [subject, record] of Object.entries(data.records[method] ?? {})) {
      const row = list.insertRow();
      row.insertCell().textContent = subject;
      const shown = subject in values ? `${values[subject].toFixed(columns[column].digits)} ${columns[column].unit}` : record.status;
      row.insertCell().textContent = shown;
      const link = document.createElement("a");
      link.href = record.file;
      link.textContent = "record";
      link.setAttribute("aria-label", `Record of ${subject}`);
      row.insertCell().append(link);
    }
    return [title, list];
  }

  function listen() {
    const contentOf = (target) => {
      const method = target.closest?.("a.method");
      if (method) return [method, methodContent(method.dataset.method)];
      return null;
    };
    for (const kind of ["pointerover", "focusin"]) {
      results.addEventListener(kind, (event) => {
        if (kind === "pointerover" && event.pointerType === "touch") return;
        const found = contentOf(event.target);
        if (found) openCard(...found, false);
      });
    }
    results.addEventListener("pointerout", ({ target }) => { if (target.closest("a.method")) closeSoon(); });
    results.addEventListener("focusout", ({ target }) => { if (target.closest("a.method")) closeSoon(); });
    card.addEventListener("pointerenter", () => clearTimeout(leaving));
    card.addEventListener("pointerleave", closeSoon);
    results.addEventListener("click", (event) => {
      const method = event.target.closest("a.method"), number = event.target.closest("button.value");
      if (!method && !number) return;
      event.preventDefault();
      if (method) openCard(method, methodContent(method.dataset.method), true);
      else openCard(number, numberContent(number), true);
      card.tabIndex = -1;
      card.focus({ preventScroll: true });
    });
    document.addEventListener("keydown", ({ key }) => { if (key === "Escape" && !card.hidden) closeCard()?.focus(); });
    document.addEventListener("pointerdown", ({ target }) => {
      if (!card.hidden && !card.contains(target) && !target.closest("a.method, button.value")) closeCard();
    });
  }

  // ---- dark and light

  function makeTheme() {
    const root = document.documentElement, button = document.getElementById("theme");
    const isDark = () => (root.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
    button.addEventListener("click", () => { root.dataset.theme = isDark() ? "light" : "dark"; });
  }

  // A card that an address names is open.
  function openLinked() {
    const name = decodeURIComponent(location.hash.slice(1));
    if (name.startsWith("method-")) document.getElementById(name)?.setAttribute("open", "");
  }

  makeTabs();
  for (const table of results.querySelectorAll("table[data-table]")) {
    makeSortable(table);
    makeFoldable(table);
  }
  const first = results.querySelector('table[data-table="geometry"] th.number');
  if (first) sort(first.closest("table"), first, true);
  listen();
  makeTheme();
  openLinked();
  addEventListener("hashchange", openLinked);
  HarnessPage.tablesReady = true;
})();
