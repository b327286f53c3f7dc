"use strict";

/* Shared by all pages: building nodes, formatting numbers, the theme switch. Text reaches the page as text only. */

const SVG = "http://www.w3.org/2000/svg";

function node(name, attributes, ...children) {
  return fill(document.createElement(name), attributes, children);
}

function mark(name, attributes, ...children) {
  return fill(document.createElementNS(SVG, name), attributes, children);
}

function fill(element, attributes, children) {
  for (const [key, value] of Object.entries(attributes || {})) {
    if (value !== null && value !== undefined) element.setAttribute(key, value);
  }
  element.append(...children);
  return element;
}

function fixed(value, digits) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = value.toFixed(digits);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
}

function payload(id) {
  return JSON.parse(document.getElementById(id).textContent);
}

function bytes(text) {
  return Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  try { localStorage.setItem("theme", theme); } catch { /* a browser may refuse storage to local files */ }
}

function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}

function initTheme() {
  try {
    const theme = localStorage.getItem("theme");
    if (theme === "light" || theme === "dark") document.documentElement.dataset.theme = theme;
  } catch { /* see setTheme */ }
  const button = document.getElementById("theme");
  if (button) button.addEventListener("click", () => setTheme(isDark() ? "light" : "dark"));
}

/* What is wider than its place can be scrolled with the keyboard as well, once somebody gets there by Tab. */
function reachWide() {
  for (const element of document.querySelectorAll(".scroll, .figure")) {
    if (element.scrollWidth <= element.clientWidth + 1) {
      element.removeAttribute("tabindex");
      continue;
    }
    element.tabIndex = 0;
    if (element.matches(".scroll")) {
      const caption = element.querySelector("caption");
      element.setAttribute("role", "region");
      element.setAttribute("aria-label", caption ? caption.textContent : "Table");
    }
  }
}

initTheme();
reachWide();
addEventListener("resize", reachWide);
document.addEventListener("toggle", reachWide, true);
