"use strict";
// Shared by the report and the viewer.
const make = (tag, cls, parent) => {
  const element = document.createElement(tag);
  if (cls) element.className = cls;
  if (parent) parent.append(element);
  return element;
};
// Where an event is within an element, as shares of its width and height.
const within = (event, element) => {
  const box = element.getBoundingClientRect();
  return { x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height };
};
