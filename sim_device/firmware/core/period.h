/* The control period: everything that happens by time happens in it. */
#ifndef PERIOD_H
#define PERIOD_H

#define PERIOD_US 10000
#define PERIOD_S 0.01f
#define PERIODS_PER_SECOND 100u

#endif
