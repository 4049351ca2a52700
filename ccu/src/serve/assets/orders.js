// Orders: buttons that ask the server, and what it says to that.

import { byId, element, mark, write } from "./dom.js";
import { authorization, complaint } from "./stream.js";

export class Orders {
  allowed = false;

  constructor() {
    for (const button of document.querySelectorAll("[data-order]")) {
      button.addEventListener("click", () => this.#press(button.dataset.order));
    }
    byId("move").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#move();
    });
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.allowed) this.give("halt", {});
    });
  }

  /** Whether orders are taken. */
  allow(allowed) {
    this.allowed = allowed;
    byId("orders").hidden = !allowed;
  }

  /** The axes to choose from. */
  axes(picture) {
    const chosen = byId("order-axis").value;
    const options = picture.axes.map(({ axis, name }) => element("option", { value: axis }, `${axis} ${name}`));
    byId("order-axis").replaceChildren(element("option", { value: "" }, "all"), ...options);
    byId("order-axis").value = chosen;
  }

  /** Gives an order, and tells what comes of it. */
  async give(order, words) {
    this.#tell(`${order} …`, null);
    try {
      const response = await fetch(`api/${order}`, {
        method: "POST",
        headers: { "Content-Type": "application/json", ...authorization() },
        body: JSON.stringify(words),
      });
      if (response.ok) return this.#tell(`${order}: done`, "good");
      const { message, help } = await complaint(response);
      this.#tell(help ? `${message}. ${help}` : message, "bad");
    } catch (error) {
      this.#tell(`${order}: ${error.message}`, "bad");
    }
  }

  #press(order) {
    const axis = byId("order-axis").value;
    const chosen = ["clear", "origin"].includes(order) && axis ? { axes: [Number(axis)] } : {};
    this.give(order, chosen);
  }

  #move() {
    const axis = byId("order-axis").value;
    if (!axis) return this.#tell("choose the axis that shall move", "bad");
    const speed = byId("move-speed").value;
    this.give("move", {
      axis: Number(axis),
      [byId("move-how").value]: Number(byId("move-steps").value),
      speed: speed ? Number(speed) : null,
    });
  }

  #tell(text, how) {
    write(byId("told"), text);
    mark(byId("told"), "data-how", how);
    mark(byId("told"), "title", text);
  }
}
