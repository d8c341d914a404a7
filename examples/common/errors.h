/* errors.h: how far a rendered picture is from its reference.
 *
 *     printf("RMSE %g\n", error_rmse(&shown, &reference));
 *     printf("FLIP %g\n", error_flip(&shown, &reference, 1.0f, ERROR_FLIP_PPD, &map));
 *     image_free(&map);
 *
 * Pictures are linear radiance. A mean is over all pixels and the three channels, in double. Every
 * function returns NaN where sizes differ or memory runs out. A NaN in a picture makes all but
 * PSNR and FLIP NaN: those two are of pictures as shown, in which what is no radiance is black.
 * Link errors.c, image.c and -lm.
 */
#ifndef ERRORS_H
#define ERRORS_H

#include "image.h"

/* Pixels per degree of 3840 pixels on 0.7 m, seen from 0.7 m. */
#define ERROR_FLIP_PPD 67.02f

/* Pixels per degree that error_flip takes. */
#define ERROR_FLIP_PPD_MIN 1.0f
#define ERROR_FLIP_PPD_MAX 1000.0f

/* Of all values; NaN where there are none. */
double error_mean(const image *map);

/* Root of the mean of (test - reference)^2. */
double error_rmse(const image *test, const image *reference);

/* Mean of (test - a)(test - b) of two references whose noise is independent: the expected value is
 * the squared error against what both converge to, however noisy they are. It can be negative. Over
 * the square of error_mean it is relative. */
double error_mse_two(const image *test, const image *a, const image *b);

/* error_rmse over the mean of the reference; of a black reference infinite, or 0 if both are. */
double error_relative_rmse(const image *test, const image *reference);

/* Mean, over pixels, of squared error over squared radiance, without the 0.2 % worst pixels, which
 * fireflies decide. A pixel's squared error is the mean over its channels. It is divided by r^2 +
 * 0.01 m^2: r is the mean of the reference's channels there, m that of the whole reference. So a
 * change of exposure changes nothing, and dark pixels do not decide either. */
double error_relative_mse(const image *test, const image *reference);

/* Peak signal to noise ratio in dB of pictures as shown: multiplied by `exposure`, clipped to
 * [0, 1] and encoded as sRGB, not rounded to 8 bits. Infinite where they do not differ. */
double error_psnr(const image *test, const image *reference, float exposure);

/* LDR-FLIP [Andersson et al., FLIP: A Difference Evaluator for Alternating Images, 2020]: how
 * visible the difference is when one flips between both, 0 to 1, as the mean over the picture.
 * Pictures are multiplied by `exposure` and clipped to [0, 1]. Symmetric. `map`, unless NULL,
 * gets the difference at each pixel, in all three channels; it is allocated here, and empty where
 * NaN is returned, as it is where pixels_per_degree is out of range. */
double error_flip(const image *test, const image *reference, float exposure,
                  float pixels_per_degree, image *map);

#endif
