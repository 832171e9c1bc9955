#define NAME_@CALL@_ONE @one@ /* integer for 1/ms */

/* Set signal @signal@ after a step: a value for each of the @size@ neurons of '@to@'. It acts from the next step on. */
void name_@call@(const int32_t *values);

