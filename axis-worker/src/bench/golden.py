"""The counts of NS-TC for f_start = 200, f_max = 2 000, t_a = 0.2 s, f_CK = 1 MHz, by equations (1) to (6) of [M] in 60
decimal digits. It prints what stands in tests.rs; it shares nothing with the code that is tested."""

from decimal import ROUND_HALF_EVEN, Decimal, getcontext

getcontext().prec = 60
F_START, F_MAX, T_A, F_CK = Decimal(200), Decimal(2000), Decimal("0.2"), Decimal(1_000_000)


def counts(first, last, duration):
    slope = (last - first) / duration  # (1)
    time, before, given = Decimal(0), 0, []
    while True:
        frequency = slope * time + first  # (3)
        frequency = min(max(frequency, min(first, last)), max(first, last))
        period = 1 / frequency  # (4)
        is_last = time > duration  # (6)
        time += period  # (2)
        until = int((F_CK * time).to_integral_value(ROUND_HALF_EVEN))
        given.append(until - before)  # (5), with the error carried on
        before = until
        if is_last:
            return given, F_CK * time


for name, first, last in [("UP", F_START, F_MAX), ("DOWN", F_MAX, F_START)]:
    given, exact = counts(first, last, T_A)
    print(f"{name}: {len(given)} counts, sum {sum(given)}, exactly {exact:.9f}")
    for row in range(0, len(given), 16):
        print("    " + ", ".join(str(count) for count in given[row : row + 16]) + ",")
